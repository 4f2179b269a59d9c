"""Clocks of cameras from the motion that they see: the offsets that make the rays meet."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from panoptic_ros.geometry.robust import growth
from panoptic_ros.offsets.association import Observations
from panoptic_ros.offsets.noise import Noise
from panoptic_ros.offsets.series import KNOTS, Series, make_series
from panoptic_ros.offsets.trajectories import Curves, Rays, fit_series

Array = np.ndarray
CAUCHY = 3.0  # standard deviations
ROUGHNESS = (0.02, 20.0)  # m/s^1.5, limits of the root density of white acceleration
FIRST_ROUGHNESS = 1.5
FIRST_NOISE = 3e-3  # of the normalised plane
LARGEST_STEP = 0.04  # s per iteration
ENOUGH = 2e-5  # s: largest step when converged
LEARNING = 12  # iterations for which noise and stiffness are learnt
MEMORY = 3  # states of Anderson acceleration
LARGEST_JUMP = 3.0  # steps; a longer accelerated one is not taken


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Clocks of C cameras, corrected = stamp + offset + drift * (stamp - reference), and their statistics.

    Args:
        offsets: (C,) s at the reference. drifts: (C,).
        information: (2C, 2C) of (offsets, drifts) from the rays, without any prior.
        converged: whether the last step was small. iterations: number of steps.
        seen: the N rays that were used, in the order of the trajectories.
        misses: (N, 2) m, distance of the ray from its trajectory, across the ray. across: (N, 2) m/s,
            velocity of the joint across the ray. precision: (N,) 1/m^2, weight of the ray.
    """

    offsets: Array
    drifts: Array
    information: Array
    converged: bool
    iterations: int
    seen: Observations
    misses: Array
    across: Array
    precision: Array


class _Problem:
    """The rays, and what is learnt about them during the iterations: noise, stiffness, outliers."""

    def __init__(self, series: Series, cameras: int):
        seen = series.seen
        self.series, self.cameras = series, cameras
        self._noise = Noise(seen.camera, seen.joint, seen.scores, FIRST_NOISE)
        self._stiffness = np.full(len(series.counts), 1.0 / (FIRST_ROUGHNESS**2 * KNOTS**3))
        self._ratio = np.zeros(len(seen.stamp))
        self.misses = self.across = np.zeros((len(seen.stamp), 2))
        self.precision = np.zeros(len(seen.stamp))

    def linearise(self, state: Array, learn: bool) -> tuple[Array, Array]:
        """Fit the trajectories given the clocks; information (2C, 2C), right-hand side (2C,)."""
        series, seen = self.series, self.series.seen
        times = seen.stamp + state[seen.camera] + state[self.cameras + seen.camera] * seen.stamp
        scale = 1.0 / (self._noise.sigmas() * seen.depth)
        weights = 1.0 / growth(self._ratio**2, CAUCHY)
        curves = Curves(series.starts, series.origins, series.counts, KNOTS, self._stiffness)
        rows, rights = seen.rows * scale[:, None, None], seen.rights * scale[:, None]
        fit = fit_series(curves, Rays(times, seen.camera, seen.stamp, rows, rights, weights), self.cameras)
        self.misses = np.einsum("nij,nj->ni", seen.rows, fit.positions) - seen.rights
        self.across = np.einsum("nij,nj->ni", seen.rows, fit.velocities)
        self.precision = weights * scale**2
        self._ratio = np.linalg.norm(self.misses, axis=1) * scale
        if learn:
            self._noise.learn(self._ratio / np.sqrt(np.maximum(1.0 - 0.5 * fit.leverage, 0.1)))
            self._ratio = np.linalg.norm(self.misses, axis=1) / (self._noise.sigmas() * seen.depth)
            self._stiffness = _learn_stiffness(self._stiffness, series.counts, fit.rough)
        return fit.information, fit.right


def fit_clocks(
    seen: Observations,
    cameras: int,
    offsets: Array,
    drifts: Array,
    prior: Array,
    rounds: int = 40,
    progress: Callable[[float], None] = lambda share: None,
) -> Fit:
    """Estimate offsets and drifts from the joints of tracked people.

    Gauss-Newton steps of the clocks with the trajectories eliminated and Cauchy weights, and Anderson
    acceleration once noise and stiffness have settled. Plain steps look converged while milliseconds off.

    Args:
        offsets (C,) s, drifts (C,): to start from. prior: (2C,) their standard deviations about 0.
        rounds: most iterations. progress: is told the share that is done, 0..1.
    """
    problem = _Problem(make_series(seen), cameras)
    state = centred(np.concatenate([offsets, drifts]).astype(np.float64), cameras)
    information, converged, done = np.zeros((2 * cameras, 2 * cameras)), False, 0
    history: list[tuple[Array, Array]] = []
    while len(problem.series.counts) and done < rounds and not converged:
        progress(done / rounds)
        learn = done < LEARNING
        information, right = problem.linearise(state, learn)
        step = np.linalg.solve(information + np.diag(prior**-2.0), right - state / prior**2)
        step = centred(step, cameras)
        longest = float(np.abs(step[:cameras]).max())
        done += 1
        converged = longest < ENOUGH and not learn
        step *= min(1.0, LARGEST_STEP / max(longest, 1e-12))
        history = [*history[-MEMORY:], (state, step)]
        state = state + step if done <= LEARNING // 2 else _accelerated(history, cameras)
    return Fit(
        state[:cameras],
        state[cameras:],
        information,
        converged,
        done,
        problem.series.seen,
        problem.misses,
        problem.across,
        problem.precision,
    )


def centred(values: Array, cameras: int) -> Array:
    """Offsets and drifts with mean 0, as what all cameras share is not observable."""
    parts = values[:cameras], values[cameras:]
    return np.concatenate([part - part.mean() for part in parts])


def _learn_stiffness(stiffness: Array, counts: Array, rough: Array) -> Array:
    """MacKay's update: the penalty under which the second differences are as large as expected."""
    terms = 3.0 * (counts - 2)
    sure = np.maximum(terms - stiffness * rough[:, 1], 0.05 * terms)
    low, high = (1.0 / (q**2 * KNOTS**3) for q in ROUGHNESS[::-1])
    learnt: Array = np.clip(sure / np.maximum(rough[:, 0], 1e-12), low, high)
    return learnt


def _accelerated(history: list[tuple[Array, Array]], cameras: int) -> Array:
    """Anderson mixing of the last states and steps."""
    state, step = history[-1]
    plain: Array = state + step
    if len(history) < 2:
        return plain
    steps = np.stack([step - before for _, before in history[:-1]], axis=1)
    states = np.stack([state - before for before, _ in history[:-1]], axis=1)
    mix = np.linalg.lstsq(steps, step, rcond=1e-8)[0]
    mixed = centred(plain - (states + steps) @ mix, cameras)
    jump, longest = (float(np.abs(v[:cameras]).max()) for v in (mixed - state, step))
    return mixed if jump <= LARGEST_JUMP * longest else plain
