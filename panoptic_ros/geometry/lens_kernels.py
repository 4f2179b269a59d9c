"""Compiled undistortion of many points, for the lenses of `geometry.brown` and `geometry.fisheye`.

A fisheye, and a Brown lens with radial terms only, map a point (x, y) to (x, y) * f(r^2). `fisheye_factor` is
this f, and `fisheye_slope` is 2 df / d r^2, so that Jacobians of both have one form. Lenses with more than
five terms have separate functions, so that they do not slow down the others.
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
    """Return the distorted over the undistorted radius, at a squared undistorted radius `r2`."""
    if r2 < TINY * TINY:
        return 1.0
    radius = math.sqrt(r2)
    theta = math.atan(radius)
    square = theta * theta
    return theta * (1.0 + square * (k1 + square * (k2 + square * (k3 + square * k4)))) / radius


@_jit
def fisheye_slope(k1: float, k2: float, k3: float, k4: float, r2: float, factor: float) -> float:
    """Return twice the derivative of `factor` by the squared undistorted radius `r2`."""
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
    """Return the undistorted over the distorted radius at `reached`, and whether a solution exists.

    Args:
        limit: Undistorted radius beyond which points are not visible.
        reached: Distorted radius.
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
    """Return the distorted point, and the squared radius, of a point (x, y) of the plane at 1 m.

    Args:
        terms: k1 k2 p1 p2 k3 k4 of the lens.
    """
    k1, k2, p1, p2, k3, k4 = terms
    r2 = x * x + y * y
    radial = fisheye_factor(k1, k2, k3, k4, r2) if fisheye else 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    dx = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    dy = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    return dx, dy, r2


@_jit
def bent_by_many(lens, x, y):
    """Return the distorted point, and the squared radius, for a lens of up to 14 terms.

    The point (x, y) is on the plane at 1 m.
    """
    r2 = x * x + y * y
    dx, dy = _before_tilt(lens, x, y)
    h = lens.h20 * dx + lens.h21 * dy + lens.h22
    u = (lens.h00 * dx + lens.h01 * dy + lens.h02) / h
    w = (lens.h10 * dx + lens.h11 * dy + lens.h12) / h
    return u, w, r2


@inlined
def _before_tilt(lens, x, y):
    """Return the distorted point, for a sensor without tilt."""
    r2 = x * x + y * y
    above = 1.0 + r2 * (lens.k1 + r2 * (lens.k2 + r2 * lens.k3))
    radial = above / (1.0 + r2 * (lens.k4 + r2 * (lens.k5 + r2 * lens.k6)))
    dx = x * radial + 2.0 * lens.p1 * x * y + lens.p2 * (r2 + 2.0 * x * x) + r2 * (lens.s1 + r2 * lens.s2)
    dy = y * radial + lens.p1 * (r2 + 2.0 * y * y) + 2.0 * lens.p2 * x * y + r2 * (lens.s3 + r2 * lens.s4)
    return dx, dy


@_jit
def undistort_points(pixels, usable, cameras, lenses):
    """Return undistorted normalised points, by Newton's method.

    Args:
        pixels: (D, J, 2) px.
        usable: (D, J) bool.
        cameras: (D,) row of `lenses` (C,).
        lenses: (C,) records, see `domain.rig_arrays.camera_records`.

    Returns:
        plane: (D, J, 2), 0 where unusable or not converged.
        magnification: (D, J) local scale from the plane to the image, relative to that on the axis. It is 1
            for Brown lenses of up to five terms, where it hardly differs.
        good: (D, J) usable and converged.
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
            elif lens.many > 0.0:
                x, y, zoom, found = _undistort_many(lens, goal_x, goal_y)
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
    """Return the undistorted point for a fisheye, the magnification there, and whether it was found."""
    k1, k2, k3, k4 = lens.k1, lens.k2, lens.k3, lens.k4
    reached = np.sqrt(goal_x * goal_x + goal_y * goal_y)
    scale, found = straighten_fisheye(k1, k2, k3, k4, lens.limit, reached)
    x, y = scale * goal_x, scale * goal_y
    r2 = x * x + y * y
    across = fisheye_factor(k1, k2, k3, k4, r2)
    along = across + r2 * fisheye_slope(k1, k2, k3, k4, r2, across)
    return x, y, np.sqrt(across * max(along, 1e-6)), found


@inlined
def _newton_step(x, y, slopes, miss_x, miss_y, limit):
    """Return the point after a Newton step, at most `limit` from the centre.

    Args:
        slopes: Derivatives of the distorted x by x and y, then of y by x and y.
    """
    xx, xy, yx, yy = slopes
    det = xx * yy - xy * yx
    if abs(det) < 1e-6:
        det = 1e-6
    x -= (yy * miss_x - xy * miss_y) / det
    y -= (xx * miss_y - yx * miss_x) / det
    radius = np.sqrt(x * x + y * y)
    if radius > limit:
        x *= limit / radius
        y *= limit / radius
    return x, y


@_jit
def _undistort(lens, goal_x, goal_y):
    """Return the undistorted point for a Brown lens of five terms, and whether it was found."""
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
        x, y = _newton_step(x, y, (xx, xy, xy, yy), miss_x, miss_y, limit)
    return x, y, miss < 1e-8


@_jit
def _undistort_many(lens, seen_x, seen_y):
    """Return the undistorted point for a lens of up to 14 terms, the magnification, and whether found.

    The adjugate of the homography is used as its inverse: they differ by a factor, which cancels.
    """
    h0, h1, h2 = lens.h00, lens.h01, lens.h02
    h3, h4, h5 = lens.h10, lens.h11, lens.h12
    h6, h7, h8 = lens.h20, lens.h21, lens.h22
    depth = (h3 * h7 - h4 * h6) * seen_x + (h1 * h6 - h0 * h7) * seen_y + (h0 * h4 - h1 * h3)
    goal_x = ((h4 * h8 - h5 * h7) * seen_x + (h2 * h7 - h1 * h8) * seen_y + (h1 * h5 - h2 * h4)) / depth
    goal_y = ((h5 * h6 - h3 * h8) * seen_x + (h0 * h8 - h2 * h6) * seen_y + (h2 * h3 - h0 * h5)) / depth
    x, y = goal_x, goal_y
    miss = 0.0
    for _ in range(20):
        at_x, at_y = _before_tilt(lens, x, y)
        miss_x, miss_y = at_x - goal_x, at_y - goal_y
        miss = max(abs(miss_x), abs(miss_y))
        if miss < 1e-13:
            break
        xx, xy, yx, yy = _slopes_before_tilt(lens, x, y)
        x, y = _newton_step(x, y, (xx, xy, yx, yy), miss_x, miss_y, lens.limit)
    xx, xy, yx, yy = _slopes_before_tilt(lens, x, y)
    return x, y, np.sqrt(max(xx * yy - xy * yx, 1e-6)), miss < 1e-8


@inlined
def _slopes_before_tilt(lens, x, y):
    """Return the derivatives of `_before_tilt`: of its x by x and y, then of its y by x and y."""
    r2 = x * x + y * y
    below = 1.0 + r2 * (lens.k4 + r2 * (lens.k5 + r2 * lens.k6))
    radial = (1.0 + r2 * (lens.k1 + r2 * (lens.k2 + r2 * lens.k3))) / below
    rise = lens.k1 + r2 * (2.0 * lens.k2 + 3.0 * r2 * lens.k3)
    fall = lens.k4 + r2 * (2.0 * lens.k5 + 3.0 * r2 * lens.k6)
    slope = 2.0 * (rise - radial * fall) / below
    across, down = 2.0 * (lens.s1 + 2.0 * r2 * lens.s2), 2.0 * (lens.s3 + 2.0 * r2 * lens.s4)
    both = x * y * slope + 2.0 * lens.p1 * x + 2.0 * lens.p2 * y
    xx = radial + x * x * slope + 2.0 * lens.p1 * y + 6.0 * lens.p2 * x + across * x
    yy = radial + y * y * slope + 6.0 * lens.p1 * y + 2.0 * lens.p2 * x + down * y
    return xx, both + across * y, both + down * x, yy
