"""Clock offsets, drifts and line delays of cameras as unknowns beside the curves.

The time of a ray is its timestamp + offset + drift * (timestamp - reference) + line delay * image row. The
reference is the middle of the recording. The curves are eliminated, and the clocks take Gauss-Newton steps
while noise and stiffness are learnt.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from panoptic_ros.continuous.clock_sums import OVERLAP, TERMS, clock_sums, eliminate
from panoptic_ros.continuous.observability import certain, covariance_of, known_clocks, robust_covariance
from panoptic_ros.continuous.problem import CurveProblem, TrackRays, cauchy_of
from panoptic_ros.continuous.shutters import fastest_shutter, global_shutters, line_doubts
from panoptic_ros.solving.clock_gauge import KNOWN, common_shift
from panoptic_ros.stage import Progress, untold

Array = np.ndarray
# maximum standard deviations of drifts and line delays that are applied; KNOWN is that of offsets
KNOWN_DRIFT = 7e-5
KNOWN_LINE_S = 5e-6  # s per row
ROUNDS = 16  # number of iterations
DRIFT_ROUND = 6  # iteration from which drifts are free: before, offsets are still wrong
GLOBAL_ROUND = 10  # iteration in which cameras with a global shutter are found
PRIOR_OFFSET_S = 0.1  # s, standard deviation
PRIOR_DRIFT = 1e-4
PRIOR_LINE_S = 3e-5  # s per row
MARGIN_S = 0.2  # s of curve beyond the outermost rays, because clocks may move
LARGEST_STEP_S = 0.04  # s per iteration


@dataclass(frozen=True, slots=True, eq=False)
class FreeClocks:
    """Choice of the unknowns.

    Args:
        clocks: offsets and drifts are unknown.
        lines: line delays are unknown.
        trusted: index of the camera whose clock is right; -1 = the mean of all clocks is right.
    """

    clocks: bool
    lines: bool
    trusted: int = -1


@dataclass(frozen=True, slots=True, eq=False)
class CameraTimes:
    """Clocks and line delays of C cameras.

    Args:
        values: (TERMS, C) offsets (s) at the reference, drifts, line delays (s per row).
        covariance: (TERMS * C, TERMS * C).
    """

    values: Array
    covariance: Array

    @classmethod
    def given(cls, offsets: Array, drifts: Array, lines: Array) -> CameraTimes:
        """Return times that are known."""
        count = len(offsets)
        return cls(np.stack([offsets, drifts, lines]), np.zeros((TERMS * count, TERMS * count)))

    def times(self, rays: TrackRays) -> Array:
        """Return the corrected times (N,) s of the rays of a person."""
        times: Array = rays.stamps + (self.values[:, rays.cameras].T * factors_of(rays)).sum(1)
        return times

    @property
    def deviations(self) -> Array:
        """Return the standard deviations (TERMS, C)."""
        return np.sqrt(np.diag(self.covariance)).reshape(self.values.shape)

    @property
    def observable(self) -> Array:
        """Return the values (TERMS, C) that the motion determines, or that are given."""
        known: Array = self.deviations <= np.array([[KNOWN], [KNOWN_DRIFT], [KNOWN_LINE_S]])
        return known

    def referenced(self) -> CameraTimes:
        """Return offsets and drifts relative to the cameras whose offsets, or drifts, are known.

        Offsets are relative to most of these cameras if they agree, else to their mean; drifts to the mean.
        """
        count = self.values.shape[1]
        known = known_clocks(self.covariance[:count, :count], KNOWN)
        drifting = known_clocks(self.covariance[count : 2 * count, count : 2 * count], KNOWN_DRIFT)
        gauges = [
            np.eye(count) - (chosen / chosen.sum() if chosen.any() else 0.0) for chosen in (known, drifting)
        ]
        whole = block_diag(*gauges, np.eye(count))
        found = CameraTimes(self.values.copy(), whole @ self.covariance @ whole.T)
        if known.any():
            found.values[0] -= common_shift(found.values[0, known], found.deviations[0, known])
        if drifting.any():
            found.values[1] -= found.values[1, drifting].mean()
        return found

    def applicable(self, start: CameraTimes) -> CameraTimes:
        """Return a copy in which each value that is not observable is replaced by the value of `start`.

        An estimated offset keeps the drift and line delay that were estimated with it. The motion of people
        who fall on one spot gives the times of middle rows within 1 ms, and the line delay hardly.
        """
        applied = self.observable
        applied[1:] |= applied[0] & (self.deviations[0] > 0.0)
        return CameraTimes(np.where(applied, self.values, start.values), self.covariance)


def factors_of(rays: TrackRays) -> Array:
    """Return the derivatives (N, TERMS) of the times of the rays."""
    return np.stack([np.ones(len(rays.stamps)), rays.stamps, rays.heights], axis=1)


def estimate_times(
    problems: Sequence[CurveProblem],
    start: CameraTimes,
    prior: CameraTimes,
    free: FreeClocks,
    progress: Progress = untold,
    first: int = 0,
) -> CameraTimes:
    """Return the times that fit the rays of all people best; the problems are updated on the way.

    Timestamps of the rays are relative to the reference of the clocks.

    Args:
        start: values of the first iteration.
        prior: values that are expected.
        first: first iteration, DRIFT_ROUND if the start is an earlier result.
    """
    values, given = start.values.copy(), prior.values
    cameras = values.shape[1]
    weights = np.repeat([PRIOR_OFFSET_S, PRIOR_DRIFT, PRIOR_LINE_S], cameras) ** -2.0
    trusted, fastest, still = (np.zeros(cameras, bool) for _ in range(3))
    if free.trusted >= 0:
        trusted[free.trusted] = True
    for k in range(first, ROUNDS):
        progress((k - first) / (ROUNDS - first), "estimating clocks")
        sums = _linearise(problems, values, cauchy_of(k // 2))
        if k == DRIFT_ROUND and free.lines and not trusted.any():
            fastest = fastest_shutter(values[2])
            values[2] -= values[2, fastest]
        if k == GLOBAL_ROUND and free.lines:
            unknown = _unknown(free, trusted | fastest, True)
            covariance = covariance_of(sums.information, weights, unknown)
            still = global_shutters(values[2], covariance[-cameras:, -cameras:], trusted | fastest)
            values[2, still] = 0.0
        unknown = _unknown(free, trusted | fastest | still, k >= DRIFT_ROUND)
        pull = sums.right - (values - given).reshape(-1) * weights
        step = covariance_of(sums.information, weights, unknown) @ pull
        step = centred(step.reshape(values.shape), free)
        longest = np.abs(step).max(axis=1, initial=0.0) / (LARGEST_STEP_S, PRIOR_DRIFT, PRIOR_LINE_S)
        values += step / max(1.0, float(longest.max()))
    information = certain(sums.information, sums.blur)
    covariance = robust_covariance(
        information, sums.scatter, weights, _unknown(free, trusted | fastest | still, True)
    )
    if free.lines:
        whole = covariance_of(information, weights, _unknown(free, trusted, True))
        covariance += line_doubts(values[2], whole, sums.right, still, fastest)
    if free.trusted < 0:
        gauge = np.eye(cameras) - 1.0 / cameras
        both = block_diag(gauge, gauge, np.eye(cameras))
        covariance = both @ covariance @ both.T
    return CameraTimes(values, covariance)


class _Sums(NamedTuple):
    """Normal equations of the U unknowns, without the curves.

    Args:
        information: (U, U).
        blur: (U, U) part of the information that noise of the velocities causes.
        scatter: (U, U) sum of the products of the scores of segments.
        right: (U,) sum of the scores.
    """

    information: Array
    blur: Array
    scatter: Array
    right: Array


def _linearise(problems: Sequence[CurveProblem], values: Array, cauchy: float) -> _Sums:
    """Fit all curves at the present times, and return the normal equations of the times.

    Noise and stiffness are learnt on the way.
    """
    cameras = values.shape[1]
    shape = (TERMS * cameras, TERMS * cameras)
    sums = _Sums(np.zeros(shape), np.zeros(shape), np.zeros(shape), np.zeros(shape[0]))
    for problem in problems:
        factors = factors_of(problem.seen)
        problem.times = problem.seen.stamps + (values[:, problem.seen.cameras].T * factors).sum(1)
        rays = problem.rays
        fit = problem.fit()
        at = problem.compare(fit, cauchy)
        own, noise, scores, coupling = clock_sums(
            fit, rays, problem.grid, problem.misses, problem.seen.cameras, factors, cameras
        )
        eliminate(own, coupling, fit.factors)
        problem.learn(fit, at, cauchy)
        for total, part in zip(sums, (own, noise, OVERLAP * scores.T @ scores, scores.sum(axis=0))):
            total += part
    return sums


def _unknown(free: FreeClocks, still: Array, drifts: bool) -> Array:
    """Return the indices of the unknowns.

    Args:
        still: (C,) True for cameras whose line delay is fixed.
    """
    table = np.zeros((TERMS, len(still)), bool)
    table[0], table[1], table[2] = free.clocks, free.clocks and drifts, free.lines & ~still
    if free.trusted >= 0:
        table[:, free.trusted] = False
    return np.flatnonzero(table)


def centred(step: Array, free: FreeClocks) -> Array:
    """Return a step (TERMS, C) whose offsets and drifts have mean 0, unless a camera is trusted.

    A shift common to all clocks is not observable.
    """
    if free.trusted < 0:
        step[:2] -= step[:2].mean(axis=1, keepdims=True)
    return step
