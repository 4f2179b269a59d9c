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
def basis_at(place, count, basis, slope, bend):
    """Compute the weights (SPAN,) of control points at `place`, and their first two derivatives.

    Cox and de Boor's recursion for uniform knots. The interval at an end serves places beyond that end.

    Args:
        place: time from the first knot, in knots.
        count: number of control points.
        basis, slope, bend: (SPAN,) written; derivatives are per knot.

    Returns: the index of the first of these control points.
    """
    k = min(max(int(np.floor(place)), 0), count - SPAN)
    u = place - k
    basis[:] = 0.0
    basis[0] = 1.0
    for d in range(1, SPAN):
        if d == SPAN - 2:
            for r in range(SPAN):
                bend[r] = basis[r]
                if r >= 1:
                    bend[r] -= 2.0 * basis[r - 1]
                if r >= 2:
                    bend[r] += basis[r - 2]
        if d == SPAN - 1:
            for r in range(SPAN):
                slope[r] = -basis[r]
                if r >= 1:
                    slope[r] += basis[r - 1]
        for r in range(d, -1, -1):
            value = (r + 1 - u) * basis[r]
            if r >= 1:
                value += (u - r + d) * basis[r - 1]
            basis[r] = value / d
    return k
