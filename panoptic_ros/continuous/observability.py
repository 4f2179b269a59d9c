"""Tells the motion of people from the noise of the curves, because clocks are observable by motion only.

A curve that follows noise moves, too. Without this correction, people who stand give confident clocks.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from panoptic_ros.continuous.curves import covariance_at
from panoptic_ros.continuous.problem import CurveProblem
from panoptic_ros.geometry.splines import SPAN, basis_at
from panoptic_ros.kernels import njit
from panoptic_ros.solving.clock_gauge import KNOWN, acquainted

Array = np.ndarray


def motion_shares(problems: Sequence[CurveProblem], cameras: int) -> Array:
    """Return the share (C,) of the squared speeds across the rays of each camera that is no noise, 0..1."""
    moved, noise = np.zeros(cameras), np.zeros(cameras)
    for problem in problems:
        squares, variances = speeds_across(problem.fit(), problem.rays, problem.grid)
        moved += np.bincount(problem.seen.cameras, squares, cameras)
        noise += np.bincount(problem.seen.cameras, variances, cameras)
    shares: Array = np.clip(1.0 - noise / np.maximum(moved, 1e-12), 0.0, 1.0)
    return shares


@njit(cache=True, error_model="numpy", nogil=True)
def speeds_across(fit, rays, grid):
    """Return the squared speeds (N,) of the curves across the rays, and their variances (N,).

    Both are 1/s^2, in units of the standard deviation of a ray.
    """
    squares, variances = np.zeros(len(rays.times)), np.zeros(len(rays.times))
    basis, slope, bend = np.empty(SPAN), np.empty(SPAN), np.empty(SPAN)
    velocity, spread = np.empty(3), np.empty((3, 3))
    for j in range(len(rays.starts) - 1):
        points, inverse = fit.points[j], fit.inverses[j]
        for i in range(rays.starts[j], rays.starts[j + 1]):
            k = basis_at((rays.times[i] - grid.origin) / grid.step, grid.count, basis, slope, bend)
            velocity[:] = 0.0
            for p in range(SPAN):
                slope[p] /= grid.step
                for a in range(3):
                    velocity[a] += slope[p] * points[k + p, a]
            covariance_at(inverse, k, slope, k, slope, spread)
            weight = 1.0 / (rays.growths[i] * rays.sigmas[i] ** 2)
            for e in range(2):
                speed = 0.0
                for a in range(3):
                    speed += rays.rows[i, e, a] * velocity[a]
                    for b in range(3):
                        variances[i] += weight * rays.rows[i, e, a] * spread[a, b] * rays.rows[i, e, b]
                squares[i] += weight * speed * speed
    return squares, variances


def known_clocks(covariance: Array) -> Array:
    """Return the cameras (C,) whose offsets are known relative to each other; none, if fewer than two.

    Args:
        covariance: (C, C) of the offsets.
    """
    members = acquainted(covariance)
    inside = covariance[np.ix_(members, members)]
    variances = np.diag(inside) - 2.0 * inside.mean(axis=1) + inside.mean()
    return members & (members.sum() > 1) & (variances.max() <= KNOWN**2)
