"""The lens model of Brown and Conrady, k1 k2 p1 p2 k3, as in OpenCV.

Points are on the plane at distance 1 of the camera; `terms` are the five numbers.
"""
from __future__ import annotations

import numpy as np

Array = np.ndarray
TERMS = ("k1", "k2", "p1", "p2", "k3")


def distort(terms: Array, plane: Array) -> Array:
    """Distorted points (..., 2) of undistorted ones (..., 2)."""
    k1, k2, p1, p2, k3 = terms
    x, y = plane[..., 0], plane[..., 1]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return np.stack(
        [
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        ],
        axis=-1,
    )


def jacobian(terms: Array, plane: Array) -> Array:
    """Derivative (..., 2, 2) of `distort` at undistorted points (..., 2)."""
    k1, k2, p1, p2, k3 = terms
    x, y = plane[..., 0], plane[..., 1]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3))  # d radial / d r2, times 2
    cross = x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
    dx = radial + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
    dy = radial + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
    return np.stack([np.stack([dx, cross], -1), np.stack([cross, dy], -1)], axis=-2)


def undistort(terms: Array, goal: Array, radius_limit: float) -> Array:
    """Undistorted points (..., 2) of distorted ones (..., 2), by Newton's method; NaN if there is none."""
    if not terms.any():
        return goal
    plane = goal.copy()
    limit = min(radius_limit, 1e3)
    for _ in range(20):
        miss = distort(terms, plane) - goal
        if not np.nanmax(np.abs(miss), initial=0.0) > 1e-14:
            break
        j = jacobian(terms, plane)
        det = j[..., 0, 0] * j[..., 1, 1] - j[..., 0, 1] * j[..., 1, 0]
        det = np.where(np.abs(det) > 1e-6, det, 1e-6)
        step_x = (j[..., 1, 1] * miss[..., 0] - j[..., 0, 1] * miss[..., 1]) / det
        step_y = (j[..., 0, 0] * miss[..., 1] - j[..., 1, 0] * miss[..., 0]) / det
        plane = plane - np.stack([step_x, step_y], axis=-1)
        radius = np.linalg.norm(plane, axis=-1, keepdims=True)
        plane = np.where(radius > limit, plane * (limit / np.maximum(radius, 1e-12)), plane)
    good = np.abs(distort(terms, plane) - goal).max(axis=-1) < 1e-8
    return np.where(good[..., None], plane, np.nan)


def radius_limit(terms: Array) -> float:
    """Largest undistorted radius up to which the radial polynomial increases; inf if always."""
    k1, k2, _, _, k3 = np.where(np.abs(terms) < 1e-15, 0.0, terms)  # roots() divides by them
    roots = np.roots([7.0 * k3, 5.0 * k2, 3.0 * k1, 1.0])  # of d(r * radial)/dr, in r^2
    real = roots[(np.abs(roots.imag) < 1e-9) & (roots.real > 0.0)].real
    return float(np.sqrt(real.min())) if real.size else float("inf")
