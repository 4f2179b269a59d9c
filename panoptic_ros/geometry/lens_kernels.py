"""Compiled undistortion: that of `geometry.brown` and `geometry.fisheye`, of many points in one loop.

Where the terms are 0 but the radial ones, a Brown lens bends a point (x, y) to (x, y) * f(r^2), and so does a
fisheye: `fisheye_factor` is this f, and `fisheye_slope` is 2 df / d r^2, so that Jacobians have one form.
"""
from __future__ import annotations

import math

import numpy as np

from panoptic_ros.kernels import inlined, njit

Array = np.ndarray
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


@inlined
def bent(terms, fisheye, x, y):
    """Where a lens of terms k1 k2 p1 p2 k3 k4 bends a point of the plane at 1 m; its distance squared."""
    k1, k2, p1, p2, k3, k4 = terms
    r2 = x * x + y * y
    radial = fisheye_factor(k1, k2, k3, k4, r2) if fisheye else 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    dx = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    dy = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    return dx, dy, r2


@_jit
def undistort_points(pixels, usable, cameras, lenses):
    """Undistorted normalised points by Newton's method.

    Args:
        pixels: (D, J, 2) px. usable: (D, J) bool. cameras: (D,) row of `lenses` (C,), see
            `domain.rig_arrays.camera_records`.

    Returns:
        plane (D, J, 2), 0 where unusable; magnification (D, J): how large a small thing of the plane is in
        the image, relative to one at the axis (1 with Brown lenses, where it hardly differs); good (D, J):
        usable and converged.
    """
    rows, joints = usable.shape
    plane = np.zeros((rows, joints, 2))
    magnification = np.ones((rows, joints))
    good = np.zeros((rows, joints), np.bool_)
    for d in range(rows):
        lens = lenses[cameras[d]]
        for j in range(joints):
            if not usable[d, j]:
                continue
            goal_y = (pixels[d, j, 1] - lens.cy) / lens.fy
            goal_x = (pixels[d, j, 0] - lens.cx - lens.skew * goal_y) / lens.fx
            if lens.fisheye > 0.0:
                x, y, zoom, found = _straighten(lens, goal_x, goal_y)
                magnification[d, j] = zoom if found else 1.0
            else:
                x, y, found = _undistort(lens, goal_x, goal_y)
            if found:
                plane[d, j, 0] = x
                plane[d, j, 1] = y
                good[d, j] = True
    return plane, magnification, good


@_jit
def _straighten(lens, goal_x, goal_y):
    """The undistorted point of a fisheye's, the magnification there, and whether there is one."""
    k1, k2, k3, k4 = lens.k1, lens.k2, lens.k3, lens.k4
    reached = np.sqrt(goal_x * goal_x + goal_y * goal_y)
    scale, found = straighten_fisheye(k1, k2, k3, k4, lens.limit, reached)
    x, y = scale * goal_x, scale * goal_y
    r2 = x * x + y * y
    across = fisheye_factor(k1, k2, k3, k4, r2)
    along = across + r2 * fisheye_slope(k1, k2, k3, k4, r2, across)
    return x, y, np.sqrt(across * max(along, 1e-6)), found


@_jit
def _undistort(lens, goal_x, goal_y):
    """The undistorted point of a Brown lens's, and whether there is one."""
    k1, k2, p1, p2, k3, limit = lens.k1, lens.k2, lens.p1, lens.p2, lens.k3, lens.limit
    straight = k1 == 0.0 and k2 == 0.0 and p1 == 0.0 and p2 == 0.0 and k3 == 0.0
    x, y = goal_x, goal_y
    miss = 0.0
    for _ in range(0 if straight else 20):
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3))
        miss_x = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) - goal_x
        miss_y = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y - goal_y
        miss = max(abs(miss_x), abs(miss_y))
        if miss < 1e-13:
            break
        xx = radial + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
        yy = radial + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
        xy = x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
        det = xx * yy - xy * xy
        if abs(det) < 1e-6:
            det = 1e-6
        x -= (yy * miss_x - xy * miss_y) / det
        y -= (xx * miss_y - xy * miss_x) / det
        radius = np.sqrt(x * x + y * y)
        if radius > limit:
            x *= limit / radius
            y *= limit / radius
    return x, y, miss < 1e-8
