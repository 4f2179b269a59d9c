"""Curves of all degrees of freedom of one person at once, from rays (Gauss-Newton).

The prior and its stiffness are those of the joint curves: per degree of freedom and time, learnt by MacKay's
rule. Limits of angles are integrals over the curve: the squared excess, by Gauss points (paper, 4.3).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import leggauss

from panoptic_ros.continuous.block_bands import covariances_in_band, factor_blocks, solve_blocks
from panoptic_ros.continuous.curves import ORDER, REACH, jerk_weights
from panoptic_ros.continuous.elhayek.skeleton import HingeSkeleton
from panoptic_ros.continuous.problem import CurveProblem, learn_stiffness
from panoptic_ros.continuous.subjects.system import add_rays, blocks_of, squares_of
from panoptic_ros.geometry.splines import DEGREE, SPAN, spline

Array = np.ndarray
# m/s^2.5 and rad/s^2.5: less loose than that of joints, because the rays have weights already. From 100, top
# speed has 10 % more error after 12 rounds; from 1000, the stiffness takes 16 rounds to settle
START_JERK = 300.0
ROUNDS = 12  # number of iterations in which the stiffness is learnt
HALVINGS = 5  # maximum number of halvings of a step that does not reduce the energy
LIMIT_SD = 0.1  # rad, standard deviation of the limits
LIMIT_S = 0.1  # s, time over which an excess counts as one measurement
POINTS = 3  # Gauss points between two knots
VAGUE = 1.0  # 1/rad^2 or 1/m^2 per knot, information that keeps what nothing determines near the start
PART = 512  # number of instants at which the skeleton is placed at once


@dataclass(frozen=True, eq=False)
class FreedomFit:
    """Curves of D degrees of freedom over a window.

    Args:
        points: (K, D) control points, m and rad.
        covariances: (K - DEGREE + 1, D, D), at the knots.
    """

    points: Array
    covariances: Array


class FreedomProblem:
    """Curves of one person over a window, and the stiffness that is learnt with them.

    Args:
        problem: solved problem of the joint curves, which gives the rays with their noise. Its weights are
            updated. All rays are of joints of the skeleton.
        skeleton: skeleton of the person.
        start: (K, D) control points near the solution.
    """

    def __init__(self, problem: CurveProblem, skeleton: HingeSkeleton, start: Array):
        self._problem, self._skeleton, self._grid = problem, skeleton, problem.grid
        self._start = start
        self._stiffness = np.full(
            (start.shape[1], len(start) - ORDER), 1.0 / (START_JERK**2 * self._grid.step**5)
        )
        joints = np.flatnonzero(skeleton.site_segments >= 0)
        self._moving = np.zeros((len(skeleton.site_segments), start.shape[1]), bool)
        self._moving[joints, :3] = True
        above = skeleton.above[skeleton.site_segments[joints]].astype(float)
        self._moving[joints, 3:] = above @ (skeleton.mapping != 0.0) > 0.0
        self._reach = REACH if problem.persistent > 0.0 else SPAN
        places, weights = leggauss(POINTS)
        at_points = spline(0.0, 1.0, np.eye(SPAN))(0.5 + 0.5 * places)
        self._limit_basis = at_points  # (Q, SPAN)
        self._limit_weights = 0.5 * self._grid.step * weights / (LIMIT_SD**2 * LIMIT_S)

    def solve(self) -> FreedomFit:
        """Return the curves after all steps."""
        points = self._start
        positions, slopes = self._at_rays(points)
        self._problem.place(positions)
        misses = self._problem.misses
        for _ in range(ROUNDS):
            factor, right = self._system(points, misses, slopes)
            points, misses, slopes = self._tried(points, solve_blocks(factor, right), misses, slopes)
            self._learn(points, factor)
        factor, right = self._system(points, misses, slopes)
        points, _, _ = self._tried(points, solve_blocks(factor, right), misses, slopes)
        return FreedomFit(points, self._covariances(factor))

    def _at_rays(self, points: Array) -> tuple[Array, Array]:
        """Return the joints (N, 3) m at the rays, and the derivatives (N, 2, D) of their misses."""
        seen, skeleton = self._problem.seen, self._skeleton
        times, at = np.unique(self._problem.times, return_inverse=True)
        freedoms = spline(self._grid.origin, self._grid.step, points)(times)
        positions = np.zeros((len(at), 3))
        derivatives = np.zeros((len(at), 2, points.shape[1]))
        order = np.argsort(at, kind="stable")
        for low in range(0, len(times), PART):
            sites, slopes = skeleton.moved(
                freedoms[low : low + PART], skeleton.site_segments, skeleton.site_offsets
            )
            rows = order[slice(*np.searchsorted(at[order], (low, low + PART)))]
            positions[rows] = sites[at[rows] - low, seen.joints[rows]]
            derivatives[rows] = seen.rows[rows] @ slopes[at[rows] - low, seen.joints[rows]]
        return positions, derivatives

    def _system(self, points: Array, misses: Array, slopes: Array) -> tuple[Array, Array]:
        """Return the factor of `factor_blocks` and the right-hand side (K, D) of a step."""
        number, freedoms = points.shape
        columns = np.zeros((points.size, self._reach * freedoms))
        right = np.zeros(points.size)
        rays = self._problem.rays
        add_rays(columns, right, rays, self._grid, misses, slopes, self._moving)
        blocks, rights = columns.reshape(number, freedoms, -1), right.reshape(number, freedoms)
        blocks[:, :, 0] += VAGUE
        rights -= VAGUE * (points - self._start)
        scale, count = jerk_weights(self._grid.step), len(points) - ORDER
        jerks = self._jerks(points) * self._stiffness.T
        for p in range(ORDER + 1):
            rights[p : p + count] -= scale[p] * jerks
            for q in range(p + 1):
                blocks[q : q + count, :, (p - q) * freedoms] += scale[p] * scale[q] * self._stiffness.T
        excess = self._excesses(points)
        over = (excess != 0.0) * self._limit_weights[:, None]
        intervals = len(points) - DEGREE
        for p in range(SPAN):
            rights[p : p + intervals] -= np.einsum(
                "q,kqd->kd", self._limit_weights * self._limit_basis[:, p], excess
            )
            for q in range(p + 1):
                both = self._limit_basis[:, p] * self._limit_basis[:, q]
                blocks[q : q + intervals, :, (p - q) * freedoms] += np.einsum("q,kqd->kd", both, over)
        factor = blocks_of(columns, freedoms)
        factor_blocks(factor)
        return factor, rights

    def _jerks(self, points: Array) -> Array:
        """Return the third differences (K - ORDER, D) of control points, with their part of the second."""
        scale, count = jerk_weights(self._grid.step), len(points) - ORDER
        found: Array = sum(scale[p] * points[p : p + count] for p in range(ORDER + 1))
        return found

    def _excesses(self, points: Array) -> Array:
        """Return the excesses (K - DEGREE, Q, D) beyond the limits at the Gauss points, with their signs."""
        count = len(points) - DEGREE
        values = sum(self._limit_basis[:, p, None] * points[p : p + count, None] for p in range(SPAN))
        low, high = self._skeleton.limits.T
        excess: Array = np.maximum(values - high, 0.0) - np.maximum(low - values, 0.0)
        return excess

    def _energy(self, points: Array, misses: Array) -> float:
        """Return the energy of curves with misses (N, 2) m, for the present weights."""
        total = float(squares_of(self._problem.rays, misses))
        total += float((self._jerks(points) ** 2 * self._stiffness.T).sum())
        total += VAGUE * float(((points - self._start) ** 2).sum())
        return total + float(np.einsum("q,kqd->", self._limit_weights, self._excesses(points) ** 2))

    def _tried(self, points: Array, step: Array, misses: Array, slopes: Array) -> tuple[Array, Array, Array]:
        """Return the curves after the longest share of a step that reduces the energy, with residuals."""
        before = self._energy(points, misses)
        for halving in range(HALVINGS):
            tried = points + 0.5**halving * step
            positions, derivatives = self._at_rays(tried)
            if self._energy(tried, self._problem.misses_of(positions)) < before:
                self._problem.place(positions)
                return tried, self._problem.misses, derivatives
        return points, misses, slopes

    def _learn(self, points: Array, factor: Array) -> None:
        """Update the stiffness from the curves and the factor of their information."""
        freedoms, scale = points.shape[1], np.array(jerk_weights(self._grid.step))
        spreads = np.zeros_like(self._stiffness)
        each = np.arange(freedoms)
        for k, covariance in _spans(factor):
            if k < spreads.shape[1]:
                own = covariance[: ORDER + 1, :, : ORDER + 1][:, each, :, each]  # (D, 4, 4)
                spreads[:, k] = scale @ own @ scale
        differences = self._jerks(points).T ** 2
        inside = np.ones_like(spreads, bool)
        self._stiffness = learn_stiffness(self._stiffness, differences, spreads, inside, axes=1)

    def _covariances(self, factor: Array) -> Array:
        """Return the covariances (K - DEGREE + 1, D, D) at the knots."""
        freedoms, intervals = self._start.shape[1], len(self._start) - DEGREE
        found = np.empty((intervals + 1, freedoms, freedoms))
        ends = spline(0.0, 1.0, np.eye(SPAN))(np.array([0.0, 1.0]))
        for k, covariance in _spans(factor):
            if k < intervals:
                found[k] = np.einsum("p,pdqe,q->de", ends[0], covariance, ends[0])
            if k == intervals - 1:
                found[-1] = np.einsum("p,pdqe,q->de", ends[1], covariance, ends[1])
        return found


def _spans(factor: Array) -> Iterator[tuple[int, Array]]:
    """Yield the index k of a control point and the covariance (SPAN, D, SPAN, D) of it and the next ones."""
    freedoms = factor.shape[-1]
    for k, here, cross, later in covariances_in_band(factor):
        slots = (k + np.arange(1, SPAN)) % len(cross)
        covariance = np.empty((SPAN, freedoms, SPAN, freedoms))
        covariance[0, :, 0] = here
        covariance[1:, :, 0] = cross[slots]
        covariance[0, :, 1:] = cross[slots].transpose(2, 0, 1)
        covariance[1:, :, 1:] = later[slots][:, :, slots]
        yield k, covariance
