"""A window of poses in time: filter with a marginal prior, and smoothing of the instants behind it.

The state is the poses of the last two instants with their joint information. A new instant brings the
motion between (white acceleration of every degree of freedom, and what IMUs measured) and its own
evidence. The pose before the last is eliminated; what it would be for any pose of the later two is
kept, so that smoothing over a lag is a few products with a vector for each instant (Rauch, Tung and
Striebel 1965, in information form) and costs next to nothing.

`afterwards` is what instants that came later say about a pose, by eliminating them one after the other.
Of symmetric matrices one half is worked on: that takes half of the time.
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
from panoptic_ros.kinematics.pose.targets import NOTHING_BETWEEN, Anchor, Between, Evidence
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

LONGEST_STEP = 0.5  # rad or m, between two instants, that is carried on as a velocity
NEW = 0.5  # of what instants within the time of errors share, that counts as new
OPEN = 1e-3  # 1/m^2 or 1/rad^2, of what the evidence of an instant leaves open
LEAST = 1e-6  # of that, of what nothing determines at all: it is as unsure as can be


class Linked(NamedTuple):
    """What an instant added: (D, D) of second differences with the two before it, of first differences with
    the one before, of its own evidence, and its lower factor; and, given all up to it, (2 D, 2 D) of the one
    before and it, and (2 D, D) by how much errors that last pull them, see `PoseWindow.covariance`. ratio: of
    the step of time to it to the one before."""

    bend: Array
    turn: Array
    own: Array
    root: Array
    joint: Array
    pulled: Array
    weight: float
    ratio: float


class Afterwards(NamedTuple):
    """What later instants say about a pose and the one before it, (2 D, 2 D), and by how much errors that
    last pull both through them, (2 D, D); how many instants ago that was found."""

    information: Array
    pulled: Array
    age: int


def afterwards(links: Iterable[Linked], free: Array) -> Afterwards:
    """Of instants after a pose.

    Args:
        links: of these instants, the newest first.
        free: (D, D), what the evidence of an instant leaves open.
    """
    n = len(free)
    later, own, count = np.zeros((2 * n, 2 * n), order="F"), np.zeros((n, n)), 0
    for link in links:
        later = _before(link, later)
        own += link.own
        count += 1
    _mirror(later)
    if not count:
        return Afterwards(later, np.zeros((2 * n, n)), 0)
    # what moves all later evidence by the same moves the pose by it: motion says nothing against that
    whole = later[:, :n] + later[:, n:]
    return Afterwards(later, forward(factor_of(own / count + free), whole.T).T, 0)


def _before(link: Linked, later: Array) -> Array:
    """What an instant and all after it say about the two before it, from what those after it say about it and
    the one before; the lower half of (2 D, 2 D), by columns."""
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
    """The lower halves of what the newest of three instants has with itself and the two before have with one
    another, and all that it has with them."""
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
    """Fill the upper half from the lower one."""
    for j in range(len(matrix)):
        for i in range(j):
            matrix[i, j] = matrix[j, i]


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


class _Eliminated(NamedTuple):
    """A pose that later ones determine: its step from `pose` is u with factor factor^T u = -rows [v; w; 1],
    for steps v and w of the two later ones from `later` and `last`."""

    pose: Pose
    later: Pose
    last: Pose
    factor: Array
    rows: Array


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
        self._next: Pose | None = None  # what is predicted a period on, once somebody asked
        self._stride = 1  # periods between the last two poses
        self._information = self.start
        self._pulled = np.zeros((2 * self._size, self._size))
        self._open = OPEN * np.eye(self._size)
        self._eliminated: deque[_Eliminated] = deque(maxlen=lag + 1)
        self._linked: deque[Linked] = deque(maxlen=lag + 1)
        self._after: Afterwards | None = None  # as it was found last
        self.iterations = 0

    @property
    def last(self) -> Pose:
        """The newest pose."""
        return self._poses[1]

    @property
    def start(self) -> Array:
        """What is known of the first two poses, (2 D, 2 D): about where they are, and that they are slow."""
        slow = np.diag(np.full(self._size, 1.0))
        speed = np.r_[np.full(3, 1.0), np.full(self._size - 3, 0.5)]
        still = np.diag(speed / self._motion.period**2)
        found: Array = np.block([[slow + still, -still], [-still, slow + still]])
        return found

    def take_chain(self, chain: Chain) -> None:
        """Go on with other lengths."""
        self._chain = chain

    def predicted(self, stride: int = 1) -> Pose:
        """The pose so many periods after the last one, at constant velocity."""
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
        evidence: Evidence,
        between: Between = NOTHING_BETWEEN,
        iterations: int = 5,
    ) -> Pose:
        """Take in the evidence of the next instant: its pose.

        Args:
            guess: where it begins, see `predicted`.
        """
        n, ratio = self._size, between.stride / self._stride
        bend, slope, turn, pull = self._between(guess, between)
        # the pose before the last, against the last and the new one
        corner, rows = np.empty((n, n)), np.empty((n, 3 * n + 1), order="F")
        begin_elimination(self._information, self._pulled, (bend, slope), ratio, corner, rows)
        first = factor_of(corner)
        self._eliminated.append(
            _Eliminated(
                self._poses[0].copy(), self._poses[1].copy(), guess.copy(), first, rows[:, : 2 * n + 1]
            )
        )
        both = forward(first, rows)
        solved, pulled = both[:, : 2 * n + 1], both[:, : 2 * n].T @ both[:, 2 * n + 1 :]
        rest = solved.T @ solved
        add_motion(self._information, (bend, slope, ratio), (turn, pull), rest)
        # the last one against the new one
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
        self._linked.append(Linked(bend, turn, own, root, full, self._pulled, evidence.weight, ratio))
        self._poses, self._next = [middle, pose], None
        if self._after is not None:
            self._after = self._after._replace(age=self._after.age + 1) if between.stride == 1 else None
        self._stride = between.stride
        return pose

    def covariance(self, back: int, lasting: float, kept: int = 0) -> Array:
        """Of a step of the pose (D, D) of so many instants ago, given all so far.

        What came up to it and what came after it speak of it and of the pose before; they are added, and the
        pose before is eliminated (Fraser and Potter 1969). That takes the errors of each stretch of evidence
        for new. A share of them lasts: it pulls the pose the same way at all instants, so its steps add up,
        and not their squares (a consider covariance, Schmidt 1966). Errors of an instant are those of the
        triangular factor of its information.

        Args:
            lasting: that share of the variance.
            kept: for so many instants what came after a pose is taken to look as it did then.
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
        # by errors of 1 in all instants, less what counts as new already
        moved = found @ (pulled - rest[:, n:] - (NEW / link.weight) * link.root)
        found += lasting * link.weight * (moved @ moved.T)
        return found

    def smoothed(self) -> list[Pose]:
        """Poses of the last instants given all so far, newest first: up to lag + 2."""
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

    def _between(self, guess: Pose, between: Between) -> tuple[Array, Array, Array, Array]:
        """Matrix (D, D) and vector (D,) of second differences of the last two poses and the guess, and of
        first differences of the last one and the guess."""
        n = self._size
        stride = between.stride
        steps = 0.5 * stride * (self._stride + stride)  # periods^2: 1 where all steps are of one
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
