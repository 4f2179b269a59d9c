"""A window of poses in time: filter with a marginal prior, and smoothing of the instants behind it.

The state is the poses of the last two instants with their joint information. A new instant brings the
motion between (white acceleration of every degree of freedom, and what IMUs measured) and its own
evidence. The pose before the last is eliminated; what it would be for any pose of the later two is
kept, so that smoothing over a lag is a product of a matrix and a vector for each instant (Rauch, Tung
and Striebel 1965, in information form) and costs next to nothing.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from panoptic_ros.geometry.chain import Chain, Pose, place_sites, step_between, step_pose, turn_slopes
from panoptic_ros.geometry.rotations import vectors_of
from panoptic_ros.kinematics.solve import solve_pose
from panoptic_ros.kinematics.targets import Anchor, Evidence

Array = np.ndarray
LONGEST_STEP = 0.5  # rad or m, between two instants, that is carried on as a velocity
RIDGE = 1e-6


class Accelerations(NamedTuple):
    """Accelerations of sites at the instant before the last, world, gravity taken off (eq. 12).

    segments (N,), offsets (N, 3) m, values (N, 3) m/s^2, weights (N,) 1/(m/s^2)^2, scale of Cauchy's loss.
    differences: only the differences from the first site count; the common part is not known or not trusted.
    """

    segments: Array
    offsets: Array
    values: Array
    weights: Array
    scale: float
    differences: bool = False


class Turning(NamedTuple):
    """How segments turned between the last two instants, in the world: segments (N,), changes (N, 3, 3),
    weights (N,) 1/rad^2. A constant error of the mounting is not in it."""

    segments: Array
    changes: Array
    weights: Array


class Standing(NamedTuple):
    """Sites that stand still between the last two instants: segments (N,), offsets (N, 3) m, weights
    (N,) 1/m^2."""

    segments: Array
    offsets: Array
    weights: Array


NO_ACCELERATIONS = Accelerations(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), 0.0)
NOTHING_TURNS = Turning(np.zeros(0, np.int64), np.zeros((0, 3, 3)), np.zeros(0))
NOTHING_STANDS = Standing(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros(0))


class Between(NamedTuple):
    """What was measured between instants."""

    accelerations: Accelerations = NO_ACCELERATIONS
    turning: Turning = NOTHING_TURNS
    standing: Standing = NOTHING_STANDS


NOTHING_BETWEEN = Between()


@dataclass(frozen=True)
class Motion:
    """Standard deviations of the accelerations of the root, m/s^2, and of every joint, rad/s^2; period, s."""

    root: float
    joints: float
    period: float

    def weights(self, freedoms: int) -> Array:
        """Of the second differences (D,) of the degrees of freedom."""
        step = self.period**2
        spread = np.full(freedoms, self.joints * step)
        spread[:3] = self.root * step
        return 1.0 / spread**2


class _Conditional(NamedTuple):
    """An eliminated pose: its step from `pose` is -(matrix @ steps + shift), steps of the two later ones from
    `later` and `last`."""

    pose: Pose
    later: Pose
    last: Pose
    matrix: Array
    shift: Array


class PoseWindow:
    """Poses of one body, instant by instant.

    Args:
        lag: instants over which poses are smoothed.
    """

    def __init__(self, chain: Chain, start: Pose, motion: Motion, lag: int):
        self._chain, self._motion, self._lag = chain, motion, lag
        self._size = 3 + 3 * len(chain.parents)
        self._weights = motion.weights(self._size)
        self._poses = [start.copy(), start.copy()]
        slow = np.diag(np.full(self._size, 1.0))
        still = np.diag(np.r_[np.full(3, 1.0), np.full(self._size - 3, 0.5)] / (1.0 * motion.period) ** 2)
        self._information = np.block([[slow + still, -still], [-still, slow + still]])
        self._eliminated: deque[_Conditional] = deque(maxlen=lag + 1)
        self._own: deque[Array] = deque(maxlen=lag + 1)
        self.iterations = 0

    @property
    def last(self) -> Pose:
        """The newest pose."""
        return self._poses[1]

    def predicted(self) -> Pose:
        """The next pose at constant velocity."""
        step = np.empty(self._size)
        step_between(self._poses[0], self._poses[1], step)
        np.clip(step, -LONGEST_STEP, LONGEST_STEP, out=step)
        pose = self._poses[1].copy()
        step_pose(self._poses[1], step, pose)
        return pose

    def step(
        self,
        guess: Pose,
        evidence: Evidence,
        between: Between = NOTHING_BETWEEN,
        iterations: int = 5,
    ) -> Pose:
        """Take in the evidence of the next instant: its pose.

        Args:
            guess: where it begins, see `predicted`.
        """
        n = self._size
        matrix, vector = self._joint_system(guess, between)
        first = cho_factor(matrix[:n, :n], lower=True, check_finite=False)
        back = cho_solve(first, np.column_stack([matrix[:n, n:], vector[:n]]), check_finite=False)
        self._eliminated.append(
            _Conditional(
                self._poses[0].copy(), self._poses[1].copy(), guess.copy(), back[:, :-1], back[:, -1]
            )
        )
        rest = matrix[n:, n:] - matrix[n:, :n] @ back[:, :-1]
        pull = vector[n:] - matrix[n:, :n] @ back[:, -1]
        second = cho_factor(rest[:n, :n], lower=True, check_finite=False)
        through = cho_solve(second, np.column_stack([rest[:n, n:], pull[:n]]), check_finite=False)
        anchor = Anchor(
            guess.root.copy(), guess.turns.copy(), rest[n:, n:] - rest[n:, :n] @ through[:, :-1],
            pull[n:] - rest[n:, :n] @ through[:, -1], 1.0,
        )  # fmt: skip
        pose, hessian = guess.copy(), np.empty((n, n))
        _, self.iterations = solve_pose(self._chain, pose, evidence, anchor, iterations, hessian)
        step = np.empty(n)
        step_between(guess, pose, step)
        middle = self._poses[1].copy()
        step_pose(self._poses[1], -(through[:, :-1] @ step + through[:, -1]), middle)
        rest[n:, n:] += hessian - anchor.information
        self._information = 0.5 * (rest + rest.T)
        self._own.append(hessian)
        self._poses = [middle, pose]
        return pose

    def information(self, back: int) -> Array:
        """Of a step of the pose (D, D) of so many instants ago, given what was there then; what came later
        only adds to it."""
        return self._own[-1 - back]

    def smoothed(self) -> list[Pose]:
        """Poses of the last instants given all so far, newest first: up to lag + 2."""
        found = [self._poses[1], self._poses[0]]
        later, last = np.empty(self._size), np.empty(self._size)
        for past in reversed(self._eliminated):
            if len(found) > self._lag + 1:
                break
            step_between(past.later, found[-1], later)
            step_between(past.last, found[-2], last)
            pose = past.pose.copy()
            step_pose(past.pose, -(past.matrix @ np.concatenate([later, last]) + past.shift), pose)
            found.append(pose)
        return found

    def _joint_system(self, guess: Pose, between: Between) -> tuple[Array, Array]:
        """Information (3 D, 3 D) and gradient (3 D,) of the steps of the last two poses and the guess."""
        n = self._size
        matrix, vector = np.zeros((3 * n, 3 * n)), np.zeros(3 * n)
        matrix[: 2 * n, : 2 * n] = self._information
        before, after = np.empty(n), np.empty(n)
        step_between(self._poses[0], self._poses[1], before)
        step_between(self._poses[1], guess, after)
        change, w = after - before, self._weights
        diagonal = np.arange(n)
        for a, ca in enumerate((1.0, -2.0, 1.0)):
            vector[a * n : (a + 1) * n] += ca * w * change
            for b, cb in enumerate((1.0, -2.0, 1.0)):
                matrix[a * n + diagonal, b * n + diagonal] += ca * cb * w
        if len(between.accelerations.segments):
            slopes, residual, weights = self._acceleration_rows(guess, between.accelerations)
            weighted = slopes * weights[:, None]
            matrix += weighted.T @ slopes
            vector += weighted.T @ residual
        for rows in (
            self._turning_rows(guess, between.turning),
            self._standing_rows(guess, between.standing),
        ):
            slopes, residual, weights = rows
            if len(residual):
                weighted = slopes * weights[:, None]
                matrix[n:, n:] += weighted.T @ slopes
                vector[n:] += weighted.T @ residual
        matrix[np.arange(3 * n), np.arange(3 * n)] += RIDGE
        return matrix, vector

    def _acceleration_rows(self, guess: Pose, given: Accelerations) -> tuple[Array, Array, Array]:
        """Slopes (3 N, 3 D), residuals (3 N,) and robust weights (3 N,): second differences less what was
        measured.

        All three poses have the slopes of the middle one. With slopes of their own, which differ a little and
        are divided by the period squared, the rows would claim to know the orientation itself, and what is
        linearised at one pose and kept while the pose moves on would bend the body out of shape.
        """
        n, count = self._size, len(given.segments)
        slopes, places = np.empty((count, 3, 3 * n)), np.zeros((count, 3))
        one, middle = np.empty((count, 3, n)), np.empty((count, 3, n))
        for k, (pose, factor) in enumerate(zip((*self._poses, guess), (1.0, -2.0, 1.0))):
            into = middle if k == 1 else one
            scaled = factor / self._motion.period**2
            places += scaled * place_sites(self._chain, pose, given.segments, given.offsets, into)
        for k, factor in enumerate((1.0, -2.0, 1.0)):
            slopes[:, :, k * n : (k + 1) * n] = factor / self._motion.period**2 * middle
        residual = places - given.values
        weights = given.weights.copy()
        if given.differences:
            slopes, residual, weights = slopes[1:] - slopes[:1], residual[1:] - residual[:1], weights[1:]
        if given.scale > 0.0:
            weights /= 1.0 + weights * (residual**2).sum(-1) / given.scale
        return slopes.reshape(-1, 3 * n), residual.ravel(), np.repeat(weights, 3)

    def _turning_rows(self, guess: Pose, given: Turning) -> tuple[Array, Array, Array]:
        """Slopes (3 N, 2 D), residuals (3 N,) and weights (3 N,), with the slopes of the earlier pose
        for both."""
        n, count = self._size, len(given.segments)
        one, other = np.empty((count, 3, n)), np.empty((count, 3, n))
        begin = turn_slopes(self._chain, self._poses[1], given.segments, one)
        end = turn_slopes(self._chain, guess, given.segments, other)
        goals = given.changes @ begin
        residual = vectors_of(np.ascontiguousarray(end @ goals.swapaxes(1, 2)))
        slopes = np.concatenate([-one, one], axis=-1)
        return slopes.reshape(-1, 2 * n), residual.ravel(), np.repeat(given.weights, 3)

    def _standing_rows(self, guess: Pose, given: Standing) -> tuple[Array, Array, Array]:
        """The same of sites that stand."""
        n, count = self._size, len(given.segments)
        one, other = np.empty((count, 3, n)), np.empty((count, 3, n))
        begin = place_sites(self._chain, self._poses[1], given.segments, given.offsets, one)
        residual = place_sites(self._chain, guess, given.segments, given.offsets, other) - begin
        slopes = np.concatenate([-one, one], axis=-1)
        return slopes.reshape(-1, 2 * n), residual.ravel(), np.repeat(given.weights, 3)
