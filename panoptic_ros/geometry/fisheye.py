"""Fisheye model of OpenCV (Kannala and Brandt 2006, four terms): the image radius grows with the angle.

The model is theta_d = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8). The angle between a ray
and the camera's axis is theta. Points are on the plane at distance 1 from the camera. This plane cannot
represent rays at 90 degrees or more: such points are not visible, and such pixels have no ray. `terms` are
the four numbers.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray
TERMS = ("k1", "k2", "k3", "k4")
KEPT = (4,)  # number of terms of a lens
COUNTS = (0, 1, 2, 3, 4)  # numbers of terms that a calibration may give
WIDEST = 1e3  # largest undistorted radius that counts: rays at 89.94 degrees
TINY = 1e-12  # radius below which a point is on the axis


def distort(terms: Array, plane: Array) -> Array:
    """Return distorted points (..., 2) of undistorted ones (..., 2)."""
    radius = np.maximum(np.hypot(plane[..., 0], plane[..., 1]), TINY)
    theta = np.arctan(radius)
    distorted: Array = plane * (theta * _factor(terms, theta * theta) / radius)[..., None]
    return distorted


def undistort(terms: Array, goal: Array, radius_limit: float) -> Array:
    """Return undistorted points (..., 2) of distorted ones (..., 2), by Newton's method; NaN if none."""
    reached = np.hypot(goal[..., 0], goal[..., 1])
    last = np.arctan(radius_limit)
    theta = np.minimum(reached, last)
    for _ in range(20):
        miss = theta * _factor(terms, theta * theta) - reached
        if not np.nanmax(np.abs(miss), initial=0.0) > 1e-15:
            break
        slope = np.maximum(_slope(terms, theta * theta), 1e-6)  # above 0 before the fold
        theta = np.clip(theta - miss / slope, 0.0, last)
    good = np.abs(theta * _factor(terms, theta * theta) - reached) < 1e-9
    with np.errstate(invalid="ignore"):
        scale = np.where(reached > TINY, np.tan(theta) / np.maximum(reached, TINY), 1.0)
    return np.where(good[..., None], goal * scale[..., None], np.nan)


def radius_limit(terms: Array) -> float:
    """Return the largest undistorted radius up to which theta_d increases, at most `WIDEST`."""
    k1, k2, k3, k4 = np.where(np.abs(terms) < 1e-15, 0.0, terms)  # np.roots divides by them
    roots = np.roots([9.0 * k4, 7.0 * k3, 5.0 * k2, 3.0 * k1, 1.0])  # roots of the slope, in theta^2
    real = roots[(np.abs(roots.imag) < 1e-9) & (roots.real > 0.0)].real
    fold = float(np.sqrt(real.min())) if real.size else float("inf")
    return float(np.tan(fold)) if fold < np.arctan(WIDEST) else WIDEST


def _factor(terms: Array, square: Array) -> Array:
    """Return theta_d / theta at theta^2."""
    k1, k2, k3, k4 = terms
    factor: Array = 1.0 + square * (k1 + square * (k2 + square * (k3 + square * k4)))
    return factor


def _slope(terms: Array, square: Array) -> Array:
    """Return the derivative of theta_d by theta, at theta^2."""
    k1, k2, k3, k4 = terms
    slope: Array = 1.0 + square * (3.0 * k1 + square * (5.0 * k2 + square * (7.0 * k3 + square * 9.0 * k4)))
    return slope
