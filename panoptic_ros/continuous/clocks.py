"""Clock offsets, drifts and line delays of cameras as unknowns beside the curves.

The time of a ray is its timestamp + offset + drift * (timestamp - reference) + line delay * image row. The
reference is the middle of the recording. The curves are eliminated, and the clocks take Gauss-Newton steps
while noise and stiffness are learnt.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from panoptic_ros.continuous.clock_sums import TERMS, clock_sums, eliminate
from panoptic_ros.continuous.observability import known_clocks
from panoptic_ros.continuous.problem import CurveProblem, TrackRays, cauchy_of
from panoptic_ros.solving.clock_gauge import KNOWN, common_shift
from panoptic_ros.stage import Progress, untold

Array = np.ndarray
# maximum standard deviations of drifts and line delays that are applied; KNOWN is that of offsets
KNOWN_DRIFT = 7e-5
KNOWN_LINE_S = 5e-6  # s per row
ROUNDS = 16  # number of iterations
DRIFT_ROUND = 6  # iteration from which drifts are free: before, offsets are still wrong
GLOBAL_ROUND = 10  # iteration in which cameras with a global shutter are found
LONGEST_LINE_S = 4e-5  # s per row: 1080 rows in 43 ms
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
        free = self.deviations[2] > 0.0
        if free.any() and not (known[2] & free).any():
            known[2] = False  # the camera with line delay 0, to which these are relative, is a guess
        return known

    def referenced(self) -> CameraTimes:
        """Return offsets and drifts relative to the cameras whose offsets are known.

        They are relative to most of these cameras if they agree, else to their mean.
        """
        count = self.values.shape[1]
        known = known_clocks(self.covariance[:count, :count])
        if not known.any():
            return self
        gauge = np.eye(count) - known / known.sum()
        whole = block_diag(gauge, gauge, np.eye(count))
        found = CameraTimes(self.values.copy(), whole @ self.covariance @ whole.T)
        found.values[0] -= common_shift(found.values[0, known], found.deviations[0, known])
        found.values[1] -= found.values[1, known].mean()
        return found

    def applicable(self, start: CameraTimes) -> CameraTimes:
        """Return a copy in which each value that is not observable is replaced by the value of `start`."""
        return CameraTimes(np.where(self.observable, self.values, start.values), self.covariance)


def factors_of(rays: TrackRays) -> Array:
    """Return the derivatives (N, TERMS) of the times of the rays."""
    return np.stack([np.ones(len(rays.stamps)), rays.stamps, rays.heights], axis=1)


def estimate_times(
    problems: Sequence[CurveProblem],
    start: CameraTimes,
    free: FreeClocks,
    progress: Progress = untold,
) -> CameraTimes:
    """Return the times that fit the rays of all people best; the problems are updated on the way.

    Timestamps of the rays are relative to the reference of the clocks.
    """
    values = start.values.copy()
    cameras = values.shape[1]
    prior = np.repeat([PRIOR_OFFSET_S, PRIOR_DRIFT, PRIOR_LINE_S], cameras)
    still = np.zeros(cameras, bool)  # cameras whose line delay is fixed
    if free.trusted >= 0:
        still[free.trusted] = True
    for k in range(ROUNDS):
        progress(k / ROUNDS, "estimating clocks")
        information, blur, right = _linearise(problems, values, cauchy_of(k // 2))
        if k >= DRIFT_ROUND and free.lines and not still.any():
            still = _fastest(values)
        if k == GLOBAL_ROUND and free.lines:
            unknown = _unknown(free, still, True)
            covariance = _covariance(information, prior, unknown)
            still |= global_shutters(values[2], covariance[-cameras:, -cameras:], still)
            values[2, still] = start.values[2, still]
        unknown = _unknown(free, still, k >= DRIFT_ROUND)
        pull = right - (values - start.values).reshape(-1) / prior**2
        step = _covariance(information, prior, unknown) @ pull
        step = centred(step.reshape(values.shape), free)
        longest = np.abs(step).max(axis=1, initial=0.0) / (LARGEST_STEP_S, PRIOR_DRIFT, PRIOR_LINE_S)
        values += step / max(1.0, float(longest.max()))
    covariance = _covariance(certain(information, blur), prior, _unknown(free, still, True))
    if free.trusted < 0:
        gauge = np.eye(cameras) - 1.0 / cameras
        whole = np.kron(np.diag([1.0, 1.0, 0.0]), gauge) + np.kron(np.diag([0.0, 0.0, 1.0]), np.eye(cameras))
        covariance = whole @ covariance @ whole.T
    return CameraTimes(values, covariance)


def _linearise(
    problems: Sequence[CurveProblem],
    values: Array,
    cauchy: float,
) -> tuple[Array, Array, Array]:
    """Fit all curves at the present times; return information, its noise and right-hand side of the unknowns.

    Noise and stiffness are learnt on the way.
    """
    cameras = values.shape[1]
    size = TERMS * cameras
    information, blur, right = np.zeros((size, size)), np.zeros((size, size)), np.zeros(size)
    for problem in problems:
        factors = factors_of(problem.seen)
        problem.times = problem.seen.stamps + (values[:, problem.seen.cameras].T * factors).sum(1)
        rays = problem.rays
        fit = problem.fit()
        at = problem.compare(fit, cauchy)
        own, noise, side, coupling = clock_sums(
            fit, rays, problem.grid, problem.misses, problem.seen.cameras, factors, cameras
        )
        eliminate(own, coupling, fit.factors)
        problem.learn(fit, at, cauchy)
        information += own
        blur += noise
        right += side
    return information, blur, right


def certain(information: Array, blur: Array) -> Array:
    """Return the information (U, U) without that of noise, which looks like motion of people who stand.

    Args:
        blur: (U, U) expected information of noise.
    """
    scale = np.sqrt(np.maximum(np.diag(information), 1e-30))
    values, vectors = np.linalg.eigh((information - blur) / np.outer(scale, scale))
    kept: Array = (vectors * np.maximum(values, 0.0)) @ vectors.T * np.outer(scale, scale)
    return kept


def _covariance(information: Array, prior: Array, unknown: Array) -> Array:
    """Return the covariance of all values; known values have covariance 0."""
    covariance = np.zeros_like(information)
    normal = (information + np.diag(prior**-2.0))[np.ix_(unknown, unknown)]
    covariance[np.ix_(unknown, unknown)] = np.linalg.inv(normal)
    return covariance


def global_shutters(lines: Array, covariance: Array, still: Array) -> Array:
    """Return the cameras (C,) whose line delay is 0 rather than anything up to LONGEST_LINE_S.

    Both are equally likely before. The decision starts with the clearest camera; each one fixes its delay, so
    the others become more certain.

    Args:
        lines: (C,) s per row.
        covariance: (C, C).
        still: (C,) True for cameras that are known.
    """
    lines, covariance = lines.copy(), covariance.copy()
    found = np.zeros(len(lines), bool)
    while True:
        left = np.flatnonzero(~still & ~found)
        deviations = np.sqrt(np.maximum(np.diag(covariance)[left], 1e-16))
        scores = np.maximum(lines[left], 0.0) / deviations
        odds = np.log(LONGEST_LINE_S / (np.sqrt(2.0 * np.pi) * deviations)) - 0.5 * scores**2
        if not len(left) or odds.max() <= 0.0:
            return found
        k = left[int(odds.argmax())]
        found[k] = True
        gain = covariance[:, k] / covariance[k, k]
        lines -= gain * lines[k]
        covariance -= np.outer(gain, covariance[k])


def _fastest(values: Array) -> Array:
    """Return the camera of the shortest line delay as a mask (C,); a common change makes that delay 0.

    A change common to all line delays shifts the joints of a person against each other in time, by their
    heights in the images. Without bones nothing contradicts that shift.
    """
    still = np.zeros(values.shape[1], bool)
    still[values[2].argmin()] = True
    values[2] -= values[2].min()
    return still


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
