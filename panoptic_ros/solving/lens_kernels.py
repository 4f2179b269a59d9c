"""Compiled parts of the fisheye lens; see `geometry.fisheye`.

Where the terms are 0 but the radial ones, a Brown lens bends a point (x, y) to (x, y) * f(r^2), and so does a
fisheye: `fisheye_factor` is this f, and `fisheye_slope` is 2 df / d r^2, so that Jacobians have one form.
"""
from __future__ import annotations

import math

from panoptic_ros.kernels import njit

TINY = 1e-12  # radius below which a point is on the axis

_jit = njit(cache=True, error_model="numpy", nogil=True)


@_jit
def fisheye_factor(k1: float, k2: float, k3: float, k4: float, r2: float) -> float:
    """Distorted over undistorted radius at a squared undistorted radius."""
    if r2 < TINY * TINY:
        return 1.0
    radius = math.sqrt(r2)
    theta = math.atan(radius)
    square = theta * theta
    return theta * (1.0 + square * (k1 + square * (k2 + square * (k3 + square * k4)))) / radius


@_jit
def fisheye_slope(k1: float, k2: float, k3: float, k4: float, r2: float, factor: float) -> float:
    """Twice the derivative of the factor by the squared undistorted radius."""
    if r2 < TINY * TINY:
        return 0.0
    theta = math.atan(math.sqrt(r2))
    square = theta * theta
    growth = 1.0 + square * (3.0 * k1 + square * (5.0 * k2 + square * (7.0 * k3 + square * 9.0 * k4)))
    return (growth / (1.0 + r2) - factor) / r2


@_jit
def straighten_fisheye(
    k1: float, k2: float, k3: float, k4: float, limit: float, reached: float
) -> tuple[float, bool]:
    """Undistorted over distorted radius at a distorted radius `reached`, and whether there is such a radius.

    limit: undistorted radius beyond which nothing is seen.
    """
    if reached < TINY:
        return 1.0, True
    last = math.atan(limit)
    theta, miss = min(reached, last), 0.0
    for _ in range(20):
        square = theta * theta
        miss = theta * (1.0 + square * (k1 + square * (k2 + square * (k3 + square * k4)))) - reached
        if abs(miss) < 1e-15:
            break
        growth = 1.0 + square * (3.0 * k1 + square * (5.0 * k2 + square * (7.0 * k3 + square * 9.0 * k4)))
        theta = min(max(theta - miss / max(growth, 1e-6), 0.0), last)
    return math.tan(theta) / reached, abs(miss) < 1e-9
