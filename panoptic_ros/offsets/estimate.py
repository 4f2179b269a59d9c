"""Estimate the clocks of cameras from motion: the offsets for which the rays of a joint intersect.

`ClockFilter` is an information filter of the clocks over blocks of motion, with slow forgetting.
`JointNoiseModel` estimates the noise of 2D joints from the residuals of the fit. `TrajectoryObservations`
holds the observations by trajectory.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from panoptic_ros.geometry.robust import growth
from panoptic_ros.offsets.association import JointObservations
from panoptic_ros.offsets.trajectories import SPAN, Curves, ObservationRays, fit_series
from panoptic_ros.solving.joint_noise import JointNoiseModel

Array = np.ndarray
CAUCHY = 3.0  # standard deviations, scale of the Cauchy weights
ROUGHNESS = (0.02, 20.0)  # m/s^1.5, limits of the root spectral density of white acceleration
FIRST_ROUGHNESS = 1.5
FIRST_NOISE = 3e-3  # initial noise on the normalised image plane
LARGEST_STEP = 0.04  # s, maximum offset step per iteration
ENOUGH = 2e-5  # s, largest offset step at convergence
LEARNING = 12  # number of iterations in which noise and stiffness are learnt
MEMORY = 3  # number of previous states for Anderson acceleration
LARGEST_JUMP = 3.0  # maximum ratio of an accelerated step to the plain step; longer ones are rejected
KNOTS = 0.08  # s between spline knots
LONGEST_GAP = 0.5  # s without any ray after which a new trajectory begins
LEAST_RAYS = 12  # minimum number of rays of a trajectory
MARGIN = 0.1  # s of spline beyond the outermost rays, because clocks may still move
JUMP = 6.0  # standard deviations of an innovation beyond which a clock has jumped
LEAST_JUMP = 3e-3  # s; smaller jumps are ignored
VAGUE = 1e-3  # share of the prior's information, added to make the information of a block invertible


@dataclass(frozen=True, slots=True, eq=False)
class ClockFit:
    """Estimated clocks of C cameras: corrected = timestamp + offset + drift * (timestamp - reference).

    Args:
        offsets: (C,) s, at the reference.
        drifts: (C,) dimensionless.
        information: (2C, 2C) of (offsets, drifts) from the rays, without any prior.
        converged: True if the last step was small.
        iterations: number of steps.
        seen: (N rays) observations used, ordered by trajectory.
        misses: (N, 2) m, distance of the ray from its trajectory, across the ray.
        across: (N, 2) m/s, velocity of the joint across the ray.
        precision: (N,) 1/m^2, weight of the ray.
    """

    offsets: Array
    drifts: Array
    information: Array
    converged: bool
    iterations: int
    seen: JointObservations
    misses: Array
    across: Array
    precision: Array


class _ClockProblem:
    """Rays and the quantities learnt from them during the iterations: noise, stiffness, outlier weights."""

    def __init__(self, series: TrajectoryObservations, cameras: int):
        seen = series.seen
        self.series, self.cameras = series, cameras
        self._noise = JointNoiseModel(seen.camera, seen.joint, seen.scores, FIRST_NOISE)
        self._stiffness = np.full(len(series.counts), 1.0 / (FIRST_ROUGHNESS**2 * KNOTS**3))
        self._ratio = np.zeros(len(seen.stamp))
        self.misses = self.across = np.zeros((len(seen.stamp), 2))
        self.precision = np.zeros(len(seen.stamp))

    def linearise(self, state: Array, learn: bool) -> tuple[Array, Array]:
        """Fit the trajectories given the clocks; return information (2C, 2C) and right-hand side (2C,)."""
        series, seen = self.series, self.series.seen
        times = seen.stamp + state[seen.camera] + state[self.cameras + seen.camera] * seen.stamp
        scale = 1.0 / (self._noise.sigmas() * seen.depth)
        weights = 1.0 / growth(self._ratio**2, CAUCHY)
        curves = Curves(series.starts, series.origins, series.counts, KNOTS, self._stiffness)
        rows, rights = seen.rows * scale[:, None, None], seen.rights * scale[:, None]
        fit = fit_series(
            curves, ObservationRays(times, seen.camera, seen.stamp, rows, rights, weights), self.cameras
        )
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
    seen: JointObservations,
    cameras: int,
    offsets: Array,
    drifts: Array,
    prior: Array,
    rounds: int = 40,
    progress: Callable[[float], None] = lambda share: None,
) -> ClockFit:
    """Estimate offsets and drifts from the joints of tracked persons.

    The clocks take Gauss-Newton steps with Cauchy weights and eliminated trajectories. Once noise and
    stiffness have settled, Anderson acceleration is used. Plain steps look converged while they are still
    milliseconds off.

    Args:
        offsets: (C,) s, initial values.
        drifts: (C,) initial values.
        prior: (2C,) standard deviations of offsets and drifts about 0.
        rounds: maximum number of iterations.
        progress: callback with the share of completed iterations, 0..1.
    """
    problem = _ClockProblem(make_series(seen), cameras)
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
    return ClockFit(
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
    """Return offsets and drifts with mean 0, because a shift common to all cameras is not observable."""
    parts = values[:cameras], values[cameras:]
    return np.concatenate([part - part.mean() for part in parts])


def _learn_stiffness(stiffness: Array, counts: Array, rough: Array) -> Array:
    """Update the penalty weight by MacKay's rule, so that second differences have their expected size."""
    terms = 3.0 * (counts - 2)
    sure = np.maximum(terms - stiffness * rough[:, 1], 0.05 * terms)
    low, high = (1.0 / (q**2 * KNOTS**3) for q in ROUGHNESS[::-1])
    learnt: Array = np.clip(sure / np.maximum(rough[:, 0], 1e-12), low, high)
    return learnt


def _accelerated(history: list[tuple[Array, Array]], cameras: int) -> Array:
    """Return the next state by Anderson mixing of the last states and steps."""
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


@dataclass(frozen=True, slots=True, eq=False)
class TrajectoryObservations:
    """Observations of S trajectories.

    Args:
        starts: (S + 1,) index of the first ray of each trajectory.
        origins: (S,) s, first time of each trajectory.
        counts: (S,) number of control points.
        seen: observations, ordered by trajectory.
    """

    starts: Array
    origins: Array
    counts: Array
    seen: JointObservations


def make_series(seen: JointObservations) -> TrajectoryObservations:
    """Sort rays into trajectories; drop those with too few rays or with rays of one camera only."""
    order = np.lexsort((seen.stamp, seen.joint, seen.track))
    track, joint, stamp = seen.track[order], seen.joint[order], seen.stamp[order]
    begins = np.ones(len(order), bool)
    begins[1:] = (track[1:] != track[:-1]) | (joint[1:] != joint[:-1])
    begins[1:] |= stamp[1:] - stamp[:-1] > LONGEST_GAP
    kept = [
        order[first:last]
        for first, last in _runs(begins)
        if last - first >= LEAST_RAYS and len(np.unique(seen.camera[order[first:last]])) >= 2
    ]
    starts = np.concatenate([[0], np.cumsum([len(rays) for rays in kept])]).astype(np.int64)
    first = np.array([seen.stamp[rays[0]] - MARGIN for rays in kept])
    last = np.array([seen.stamp[rays[-1]] + MARGIN for rays in kept])
    counts = np.ceil((last - first) / KNOTS).astype(np.int64) + SPAN - 1
    rays = np.concatenate([np.empty(0, np.int64), *kept])
    fields = {name: getattr(seen, name)[rays] for name in JointObservations.__slots__}
    return TrajectoryObservations(starts, first, counts, JointObservations(**fields))


def _runs(begins: Array) -> list[tuple[int, int]]:
    first = np.flatnonzero(begins)
    return list(zip(first.tolist(), [*first[1:].tolist(), len(begins)]))


class ClockFilter:
    """Information filter of (offsets in s at the newest reference, drifts), 2C states.

    Args:
        cameras: number of cameras C.
        prior: (2C,) standard deviations about 0; the prior is never forgotten.
        memory_s: see `OffsetsConfig`.
    """

    def __init__(self, cameras: int, prior: Array, memory_s: float):
        self._cameras, self._prior, self._memory = cameras, prior, memory_s
        self._information = np.zeros((2 * cameras, 2 * cameras))
        self._vector = np.zeros(2 * cameras)

    def move(self, seconds: float) -> None:
        """Predict: move the reference ahead by `seconds`, and let the information decay."""
        back = np.eye(2 * self._cameras)
        back[: self._cameras, self._cameras :] = -seconds * np.eye(self._cameras)
        fade = np.exp(-seconds / self._memory)
        self._information = fade * back.T @ self._information @ back
        self._vector = fade * back.T @ self._vector

    def add(self, state: Array, information: Array) -> Array:
        """Update with the estimate (2C,) of a block and its information (2C, 2C).

        If the clock of a camera has jumped, its previous information is dropped first. The jump may lie
        anywhere in the block. Therefore half of the jump is added to the standard deviation of that camera's
        offset in the block.

        Returns:
            Jumps (C,) s of the clocks relative to the others, 0 for clocks that have not jumped.
        """
        jumps = np.zeros(self._cameras)
        # jumps of more clocks could not be distinguished from jumps of the others
        for _ in range(self._cameras // 2):
            camera, jump = self._jump(state, information)
            if jump == 0.0:
                break
            jumps[camera] += jump
            self._forget(camera)
            information = _less_sure(information, camera, 0.5 * jump)
        self._information = self._information + information
        self._vector = self._vector + information @ state
        return jumps

    def state(self) -> tuple[Array, Array]:
        """Return the estimate (2C,) with mean 0, and its covariance (2C, 2C) about the mean."""
        covariance = np.linalg.inv(self._information + np.diag(self._prior**-2.0))
        gauge = np.kron(np.eye(2), np.eye(self._cameras) - 1.0 / self._cameras)
        return centred(covariance @ self._vector, self._cameras), gauge @ covariance @ gauge.T

    def _jump(self, state: Array, information: Array) -> tuple[int, float]:
        """Return the camera whose jump explains most of a block's innovation, and the jump (s).

        The test is that of a shift of one offset, given the covariance of the innovation. A shift common to
        all cameras is removed first.
        """
        count = self._cameras
        before, spread = self.state()
        block = np.linalg.inv(information + np.diag(VAGUE * self._prior**-2.0))[:count, :count]
        gauge = np.eye(count) - 1.0 / count
        weight = np.linalg.pinv(gauge @ block @ gauge.T + spread[:count, :count], rcond=1e-9, hermitian=True)
        pull = weight @ (centred(state, count) - before)[:count]
        sure = np.maximum(np.diag(weight), 1e-12)
        camera = int((pull**2 / sure).argmax())
        jump = float(pull[camera] / sure[camera])
        if pull[camera] ** 2 < JUMP**2 * sure[camera] or abs(jump) < LEAST_JUMP:
            return camera, 0.0
        return camera, jump

    def _forget(self, camera: int) -> None:
        """Marginalise a camera out; information on other cameras that is independent of it is kept."""
        for k in (camera, self._cameras + camera):
            if self._information[k, k] > 0.0:
                share = self._information[k] / self._information[k, k]
                self._vector = self._vector - share * self._vector[k]
                self._information = self._information - np.outer(share, self._information[k])
            self._information[k, :] = self._information[:, k] = self._vector[k] = 0.0


def _less_sure(information: Array, k: int, deviation: float) -> Array:
    """Return the information after an independent error of this standard deviation is added to state k."""
    column = information[:, k]
    reduced: Array = information - np.outer(column, column) / (deviation**-2.0 + column[k])
    return reduced
