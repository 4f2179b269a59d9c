"""Undistortion of all 2D joints of all views in one compiled loop; see `Intrinsics.undistort`."""
from __future__ import annotations

import numpy as np

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.kernels import njit
from panoptic_ros.solving.lens_kernels import fisheye_factor, fisheye_slope, straighten_fisheye

Array = np.ndarray
FARTHEST = 1e3  # undistorted radius beyond which no joint is believed
_NUMBERS = "fx fy cx cy skew k1 k2 p1 p2 k3 k4 fisheye limit".split()
LENS = np.dtype([(name, np.float64) for name in _NUMBERS])

_jit = njit(cache=True, error_model="numpy")


def lens_records(rig: Rig) -> Array:
    """The lenses (C,) of a rig for `undistort_points`.

    Records `LENS`: the matrix; the terms k1 k2 p1 p2 k3, of a fisheye k1 k2 k3 k4; fisheye, 1 or 0; limit,
    the undistorted radius at which the distortion folds back.
    """
    return np.array([_lens(camera) for camera in rig.cameras], LENS)


def _lens(camera: Camera) -> tuple[float, ...]:
    lens, matrix = camera.intrinsics, camera.intrinsics.matrix
    if lens.lens == "fisheye":
        k1, k2, k3, k4 = lens.distortion
        terms = (k1, k2, 0.0, 0.0, k3, k4, 1.0)
    else:
        terms = (*lens.distortion, 0.0, 0.0)
    numbers = (matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], matrix[0, 1], *terms)
    return (*(float(number) for number in numbers), min(lens.radius_limit, FARTHEST))


@_jit
def undistort_points(pixels, usable, cameras, lenses):
    """Undistorted normalised points by Newton's method.

    Args:
        pixels: (D, J, 2) px. usable: (D, J) bool. cameras: (D,) row of `lenses` (C,), see `lens_records`.

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
