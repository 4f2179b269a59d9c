"""Time window of poses: a filter with a marginal prior, and fixed-lag smoothing.

The state is the poses of the last two instants with their joint information. A new instant adds the motion
model (white acceleration of every degree of freedom), the IMU measurements since the previous instant, and
its own evidence. The pose before the last is then eliminated, and its conditional solution given the two
later poses is kept. Smoothing over a lag therefore costs only a few products of a matrix and a vector per
instant (Rauch, Tung and Striebel 1965, in information form).

`afterwards` returns the information that later instants hold about a pose. It eliminates these instants one
after the other. Only one half of each symmetric matrix is computed, which halves the time.
"""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import blas

from panoptic_ros.geometry.chain import Pose, step_between, step_pose
from panoptic_ros.geometry.segment_chain import Chain
from panoptic_ros.kernels import njit
from panoptic_ros.kinematics.pose.positive_matrices import factor_of, forward, inverse_of, solved_by
from panoptic_ros.kinematics.pose.solve import solve_pose
from panoptic_ros.kinematics.pose.targets import NOTHING_BETWEEN, Anchor, IncrementEvidence, PoseEvidence
from panoptic_ros.kinematics.pose.window_sums import (
    add_motion,
    begin_elimination,
    join,
    left_over,
    meet,
    motion_between,
    steps_between,
    told_by,
)

Array = np.ndarray

LONGEST_STEP = 0.5  # rad or m, largest increment between two instants in a constant-velocity prediction
NEW = 0.5  # fraction of an error common to the instants within `error_time` that is treated as independent
OPEN = 1e-3  # 1/m^2 or 1/rad^2, assumed information about what the evidence of an instant leaves unobserved
LEAST = 1e-6  # fraction of OPEN, information about degrees of freedom that no data determine


class WindowEntry(NamedTuple):
    """Contribution of one instant to the window.

    Attributes:
        bend: (D, D), matrix of second differences with the two instants before.
        turn: (D, D), matrix of first differences with the instant before.
        own, root: (D, D), information of the instant's own evidence, and the lower Cholesky factor of it plus
            the assumed information OPEN.
        joint: (2 D, 2 D), information of the pose before and this pose, given all data up to this instant.
        pulled: (2 D, D), sensitivity of these two poses to persistent errors, see `PoseWindow.covariance`.
        weight: Weight of the evidence, 0 to 1.
        ratio: Ratio of the time step to this instant to the time step before.
    """

    bend: Array
    turn: Array
    own: Array
    root: Array
    joint: Array
    pulled: Array
    weight: float
    ratio: float


class LaterInformation(NamedTuple):
    """Information of later instants about a pose and the pose before it.

    Attributes:
        information: (2 D, 2 D).
        pulled: (2 D, D), sensitivity of the two poses to persistent errors, through these later instants.
        age: Number of instants since this was computed.
    """

    information: Array
    pulled: Array
    age: int


def afterwards(links: Iterable[WindowEntry], free: Array) -> LaterInformation:
    """Return the information that the instants after a pose hold about it.

    Args:
        links: Contributions of these instants, the newest first.
        free: (D, D), assumed information about what the evidence of an instant leaves unobserved.
    """
    n = len(free)
    later, own, count = np.zeros((2 * n, 2 * n), order="F"), np.zeros((n, n)), 0
    for link in links:
        later = _before(link, later)
        own += link.own
        count += 1
    _mirror(later)
    if not count:
        return LaterInformation(later, np.zeros((2 * n, n)), 0)
    # an error common to all later evidence shifts the pose by the same amount, as the motion model does not
    # resist a common shift
    whole = later[:, :n] + later[:, n:]
    return LaterInformation(later, forward(factor_of(own / count + free), whole.T).T, 0)


def _before(link: WindowEntry, later: Array) -> Array:
    """Return the information (2 D, 2 D) of an instant and all later ones about the two instants before.

    Only the lower half is computed, in column order.

    Args:
        later: (2 D, 2 D), information of the later instants about this one and the one before, in the same
            form.
    """
    n = len(link.own)
    newest, against = np.empty((n, n), order="F"), np.empty((n, 2 * n), order="F")
    found = np.empty((2 * n, 2 * n), order="F")
    _assemble((link.bend, link.ratio), link.turn, link.own, later, newest, against, found)
    solved = forward(factor_of(newest.T), against)
    left: Array = blas.dsyrk(-1.0, solved, 1.0, found, trans=1, lower=1, overwrite_c=1)
    return left


@njit(cache=True, error_model="numpy", nogil=True)
def _assemble(
    second: tuple[Array, float],
    turn: Array,
    own: Array,
    later: Array,
    newest: Array,
    against: Array,
    found: Array,
) -> None:
    """Assemble the blocks for the elimination of the newest of three instants.

    Args:
        second: Matrix (D, D) of second differences, and the ratio of the later time step to the earlier one.
        turn, own: (D, D), matrix of first differences, and information of the newest instant's evidence.
        later: (2 D, 2 D), lower half, information of later instants about the newest two.
        newest: (D, D) output, lower half, the block of the newest instant with itself.
        against: (D, 2 D) output, its blocks with the two instants before.
        found: (2 D, 2 D) output, lower half, the blocks of these two with one another.
    """
    bend, ratio = second
    n, middle = len(bend), 1.0 + ratio
    for j in range(n):
        for i in range(n):
            k, t = bend[j, i], turn[j, i]
            against[i, j] = ratio * k
            against[i, n + j] = later[n + i, j] - middle * k - t
            found[n + i, j] = -ratio * middle * k
            if i >= j:
                newest[i, j] = k + t + own[j, i] + later[n + i, n + j]
                found[i, j] = ratio * ratio * k
                found[n + i, n + j] = middle * middle * k + t + later[i, j]


@njit(cache=True, error_model="numpy", nogil=True)
def _mirror(matrix: Array) -> None:
    """Fill the upper half of a symmetric matrix from its lower half."""
    for j in range(len(matrix)):
        for i in range(j):
            matrix[i, j] = matrix[j, i]


@dataclass(frozen=True)
class AccelerationModel:
    """Motion model of white acceleration.

    Attributes:
        root: m/s^2, standard deviation of the acceleration of the root, per axis.
        joints: rad/s^2, the same of every joint.
        period: s.
    """

    root: float
    joints: float
    period: float

    def weights(self, freedoms: int) -> Array:
        """Return the weights (D,) of second differences of the degrees of freedom."""
        step = self.period**2
        spread = np.full(freedoms, self.joints * step)
        spread[:3] = self.root * step
        return 1.0 / spread**2


class _EliminatedPose(NamedTuple):
    """An eliminated pose, as a function of the two later poses.

    Its increment u from `pose` solves factor factor^T u = -rows [v; w; 1]. Here v and w are the increments of
    the two later poses from `later` and `last`.
    """

    pose: Pose
    later: Pose
    last: Pose
    factor: Array
    rows: Array


class PoseWindow:
    """Filter and smoother for the poses of one body, one instant at a time.

    Args:
        start: First pose.
        lag: Number of instants over which poses are smoothed.
    """

    def __init__(self, chain: Chain, start: Pose, motion: AccelerationModel, lag: int):
        self._chain, self._motion, self._lag = chain, motion, lag
        self._size = 3 + 3 * len(chain.parents)
        self._weights = motion.weights(self._size)
        self._poses = [start.copy(), start.copy()]
        self._next: Pose | None = None  # cached prediction one period ahead; None = not computed yet
        self._stride = 1  # number of periods between the last two poses
        self._information = self.start
        self._pulled = np.zeros((2 * self._size, self._size))
        self._open = OPEN * np.eye(self._size)
        self._eliminated: deque[_EliminatedPose] = deque(maxlen=lag + 1)
        self._linked: deque[WindowEntry] = deque(maxlen=lag + 1)
        self._after: LaterInformation | None = None  # result of the last call of `afterwards`
        self.iterations = 0

    @property
    def last(self) -> Pose:
        """Return the newest pose."""
        return self._poses[1]

    @property
    def start(self) -> Array:
        """Return the prior information (2 D, 2 D) of the first two poses.

        Standard deviations are 1 m or rad per degree of freedom, 1 m/s for the root and 1.4 rad/s for the
        joints.
        """
        slow = np.diag(np.full(self._size, 1.0))
        speed = np.r_[np.full(3, 1.0), np.full(self._size - 3, 0.5)]
        still = np.diag(speed / self._motion.period**2)
        found: Array = np.block([[slow + still, -still], [-still, slow + still]])
        return found

    def take_chain(self, chain: Chain) -> None:
        """Continue with other segment lengths."""
        self._chain = chain

    def predicted(self, stride: int = 1) -> Pose:
        """Return the pose `stride` periods after the last one, at constant velocity."""
        if self._next is None or stride != 1:
            step = np.empty(self._size)
            step_between(self._poses[0], self._poses[1], step)
            np.clip(stride / self._stride * step, -LONGEST_STEP, LONGEST_STEP, out=step)
            found = self._poses[1].copy()
            step_pose(self._poses[1], step, found)
            if stride != 1:
                return found
            self._next = found
        return self._next.copy()

    def step(
        self,
        guess: Pose,
        evidence: PoseEvidence,
        between: IncrementEvidence = NOTHING_BETWEEN,
        iterations: int = 5,
    ) -> Pose:
        """Add the next instant and return its pose.

        Args:
            guess: Initial pose of the optimisation, see `predicted`.
            evidence, between: Measurements at the instant, and since the previous one.
            iterations: Maximum number.
        """
        n, ratio = self._size, between.stride / self._stride
        bend, slope, turn, pull = self._between(guess, between)
        # eliminate the pose before the last, which is coupled to the last and the new one
        corner, rows = np.empty((n, n)), np.empty((n, 3 * n + 1), order="F")
        begin_elimination(self._information, self._pulled, (bend, slope), ratio, corner, rows)
        first = factor_of(corner)
        self._eliminated.append(
            _EliminatedPose(
                self._poses[0].copy(), self._poses[1].copy(), guess.copy(), first, rows[:, : 2 * n + 1]
            )
        )
        both = forward(first, rows)
        solved, pulled = both[:, : 2 * n + 1], both[:, : 2 * n].T @ both[:, 2 * n + 1 :]
        rest = solved.T @ solved
        add_motion(self._information, (bend, slope, ratio), (turn, pull), rest)
        # eliminate the last pose, which is coupled to the new one
        second = factor_of(rest[:n, :n])
        against = np.array(rest[:n, n:], order="F")
        solved = forward(second, against)
        anchor = Anchor(guess.root.copy(), guess.turns.copy(), np.empty((n, n)), np.empty(n), 1.0)
        left_over(rest, solved[:, :-1].T @ solved, anchor.information, anchor.gradient)
        pose, hessian = guess.copy(), np.empty((n, n))
        _, self.iterations = solve_pose(self._chain, pose, evidence, anchor, iterations, hessian)
        step = np.ones(n + 1)
        step_between(guess, pose, step[:-1])
        middle = self._poses[1].copy()
        step_pose(self._poses[1], -solved_by(second, against @ step), middle)
        own, opened = np.empty((n, n)), np.empty((n, n))
        told_by(hessian, anchor.information, self._open, own, opened)
        root = factor_of(opened)
        full, before, self._pulled = np.empty((2 * n, 2 * n)), self._pulled, np.empty((2 * n, n))
        join(rest, (hessian, anchor.information), (pulled, before, root), full, self._pulled)
        self._information = full
        self._linked.append(WindowEntry(bend, turn, own, root, full, self._pulled, evidence.weight, ratio))
        self._poses, self._next = [middle, pose], None
        if self._after is not None:
            self._after = self._after._replace(age=self._after.age + 1) if between.stride == 1 else None
        self._stride = between.stride
        return pose

    def covariance(self, back: int, lasting: float, kept: int = 0) -> Array:
        """Return the covariance (D, D) of the pose increment `back` instants ago, given all data so far.

        Information from before and after the instant is about its pose and the pose before. Both are added,
        and the pose before is eliminated (Fraser and Potter 1969). This treats the errors of each period of
        `error_time` as independent. A fraction of their variance is persistent, however. Persistent errors
        pull the pose in the same direction at all instants, so their effects add up linearly. This is a
        consider covariance (Schmidt 1966). The unit errors of an instant are defined by the triangular factor
        of its information.

        Args:
            lasting: Persistent fraction of the error variance.
            kept: Number of instants for which the information from after a pose is reused without being
                recomputed.
        """
        n = self._size
        link, after = self._linked[-1 - back], self._after if kept else None
        if after is None or after.age > kept:
            after = afterwards(itertools.islice(reversed(self._linked), back), self._open)
            self._after = after if kept else self._after
        corner, rows = np.empty((n, n)), np.empty((n, 2 * n), order="F")
        own, pulled = np.empty((n, n)), np.empty((n, n))
        here, later = (link.joint, link.pulled), (after.information, after.pulled)
        meet(here, later, corner, rows, own, pulled)
        solved = forward(factor_of(corner), rows)
        rest = solved[:, :n].T @ solved
        found = inverse_of(own - rest[:, :n] + LEAST * self._open)
        # effect of unit errors at all instants, less the part that is already treated as independent
        moved = found @ (pulled - rest[:, n:] - (NEW / link.weight) * link.root)
        found += lasting * link.weight * (moved @ moved.T)
        return found

    def smoothed(self) -> list[Pose]:
        """Return the poses of the last instants given all data so far, the newest first, lag + 2 at most."""
        found = [self._poses[1], self._poses[0]]
        n = self._size
        steps = np.ones(2 * n + 1)
        for past in reversed(self._eliminated):
            if len(found) > self._lag + 1:
                break
            steps_between((past.later, past.last), (found[-1], found[-2]), steps[:-1])
            pose = past.pose.copy()
            step_pose(past.pose, -solved_by(past.factor, past.rows @ steps), pose)
            found.append(pose)
        return found

    def _between(self, guess: Pose, between: IncrementEvidence) -> tuple[Array, Array, Array, Array]:
        """Return matrix (D, D) and vector (D,) of second differences, then both of first differences.

        Second differences are of the last two poses and the guess, first differences of the last pose and the
        guess.
        """
        n = self._size
        stride = between.stride
        steps = 0.5 * stride * (self._stride + stride)  # periods^2; 1 where both time steps are one period
        bend, slope, turn, pull = np.empty((n, n)), np.empty(n), np.empty((n, n)), np.empty(n)
        motion_between(
            self._chain,
            (self._poses[0], self._poses[1], guess),
            between,
            self._weights,
            (stride / self._stride, steps, self._motion.period),
            (bend, slope),
            (turn, pull),
        )
        return bend, slope, turn, pull
