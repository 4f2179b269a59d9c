"""Fit a straight line to points with outliers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray
HUBER = 1.345  # standard deviations; 95 % efficiency for normal noise
INLIER = 4.0  # standard deviations, maximum residual of an inlier
LEAST_NOISE = 1e-9  # s; timestamps are whole nanoseconds


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """Line y = offset + slope * x.

    It has the covariance (2, 2) of offset and slope, and the standard deviation of the noise of one point.
    """

    offset: float
    slope: float
    covariance: Array
    noise: float


def fit_line(x: Array, y: Array, noise: Array) -> Line:
    """Fit a line by Huber's method, then by least squares on the inliers until they no longer change.

    Args:
        x, y: (N,) N >= 2 different x.
        noise: (N,) standard deviations stated for the points. A larger scatter overrides them.
    """
    rows = np.stack([np.ones_like(x), x], axis=1)
    solution = _huber(rows, y)
    inliers = np.ones(len(x), bool)
    for _ in range(20):
        error = y - rows @ solution
        spread = _spread(error[inliers])
        nearer = np.abs(error) <= INLIER * spread
        if (nearer == inliers).all():
            break
        inliers = nearer
        solution = _solve(rows[inliers], y[inliers], np.ones(int(inliers.sum())))
    rows, y = rows[inliers], y[inliers]
    weights = 1.0 / np.maximum(noise[inliers], spread) ** 2
    solution = _solve(rows, y, weights)
    error = y - rows @ solution
    freedom = max(1, len(y) - 2)
    # variance factor; the variance is never below the stated one
    scale = max(1.0, float(weights @ error**2) / freedom)
    covariance = np.linalg.pinv((rows * weights[:, None]).T @ rows, hermitian=True) * scale
    return Line(float(solution[0]), float(solution[1]), covariance, float(np.sqrt(error @ error / freedom)))


def _huber(rows: Array, y: Array) -> Array:
    solution = np.array([np.median(y), 0.0])
    weights = np.ones_like(y)
    for _ in range(20):
        before, solution = solution, _solve(rows, y, weights)
        error = y - rows @ solution
        weights = np.minimum(1.0, HUBER * _spread(error) / np.maximum(np.abs(error), 1e-15))
        if np.abs(solution - before).max() < 1e-12:
            break
    return solution


def _spread(error: Array) -> float:
    return max(1.4826 * float(np.median(np.abs(error))), LEAST_NOISE)


def _solve(rows: Array, y: Array, weights: Array) -> Array:
    root = np.sqrt(weights)
    solution: Array = np.linalg.lstsq(rows * root[:, None], y * root, rcond=None)[0]
    return solution
