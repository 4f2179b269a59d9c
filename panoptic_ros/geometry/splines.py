"""Uniform B-splines of degree 4: curves whose first three derivatives are continuous.

A curve of K control points has knots at `origin + step * k` for k = 0..K - DEGREE and is defined between the
first and the last of them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.interpolate import BSpline

from panoptic_ros.kernels import njit

Array = np.ndarray
DEGREE = 4
SPAN = DEGREE + 1  # number of control points with influence at an instant


def spline(origin: float, step: float, points: Array) -> Any:
    """Return the curve as scipy's `BSpline`, which evaluates positions and derivatives.

    Args:
        origin, step: (s) time of the first knot, time between knots.
        points: (K, ...) control points, K >= SPAN.
    """
    knots = origin + step * np.arange(-DEGREE, len(points) + 1)
    return BSpline(knots, points, DEGREE, extrapolate=False)


def control_points(first: float, last: float, step: float) -> int:
    """Return the number of control points of a curve from `first` to `last` (s)."""
    return max(1, int(np.ceil((last - first) / step))) + DEGREE


@njit(cache=True, error_model="numpy")
def weights_at(place, count, basis):
    """Compute the weights (SPAN,) of control points at `place`. The interval at an end serves places beyond.

    Args:
        place: time from the first knot, in knots.
        count: number of control points.
        basis: (SPAN,) written.

    Returns: the index of the first of these control points.
    """
    k = min(max(int(np.floor(place)), 0), count - SPAN)
    u = place - k
    v, square = 1.0 - u, u * u
    basis[0] = v * v * v * v / 24.0
    basis[1] = (11.0 - 12.0 * u + square * (-6.0 + 12.0 * u - 4.0 * square)) / 24.0
    basis[2] = (11.0 + 12.0 * u + square * (-6.0 - 12.0 * u + 6.0 * square)) / 24.0
    basis[3] = (1.0 + 4.0 * u + square * (6.0 + 4.0 * u - 4.0 * square)) / 24.0
    basis[4] = square * square / 24.0
    return k


@njit(cache=True, error_model="numpy")
def basis_at(place, count, basis, slope, bend):
    """Compute `weights_at`, and their first two derivatives.

    Args:
        place, count, basis: see `weights_at`.
        slope, bend: (SPAN,) written, derivatives per knot.

    Returns: the index of the first of these control points.
    """
    k = weights_at(place, count, basis)
    u = place - k
    v, square = 1.0 - u, u * u
    slope[0] = -v * v * v / 6.0
    slope[1] = (-3.0 - 3.0 * u + square * (9.0 - 4.0 * u)) / 6.0
    slope[2] = (3.0 - 3.0 * u + square * (-9.0 + 6.0 * u)) / 6.0
    slope[3] = (1.0 + 3.0 * u + square * (3.0 - 4.0 * u)) / 6.0
    slope[4] = square * u / 6.0
    bend[0] = 0.5 * v * v
    bend[1] = -0.5 + 3.0 * u - 2.0 * square
    bend[2] = -0.5 - 3.0 * u + 3.0 * square
    bend[3] = 0.5 + u - 2.0 * square
    bend[4] = 0.5 * square
    return k
