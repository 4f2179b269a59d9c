"""Undistortion of all 2D joints of all views in one compiled loop; see `Intrinsics.undistort`."""
from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit

Array = np.ndarray


@njit(cache=True, error_model="numpy")
def undistort_points(pixels, usable, cameras, matrices, distortions, radii):
    """Undistorted normalised points by Newton's method.

    Args:
        pixels: (D, J, 2) px. usable: (D, J) bool. cameras: (D,) row in the tables that follow.
        matrices: (C, 5) fx, fy, cx, cy, skew. distortions: (C, 5) k1, k2, p1, p2, k3.
        radii: (C,) undistorted radius at which the distortion folds back.

    Returns:
        plane (D, J, 2), 0 where unusable; good (D, J): usable and converged.
    """
    rows, joints = usable.shape
    plane = np.zeros((rows, joints, 2))
    good = np.zeros((rows, joints), np.bool_)
    for d in range(rows):
        fx, fy, cx, cy, skew = matrices[cameras[d]]
        k1, k2, p1, p2, k3 = distortions[cameras[d]]
        limit = radii[cameras[d]]
        straight = k1 == 0.0 and k2 == 0.0 and p1 == 0.0 and p2 == 0.0 and k3 == 0.0
        for j in range(joints):
            if not usable[d, j]:
                continue
            goal_y = (pixels[d, j, 1] - cy) / fy
            goal_x = (pixels[d, j, 0] - cx - skew * goal_y) / fx
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
            if miss < 1e-8:
                plane[d, j, 0] = x
                plane[d, j, 1] = y
                good[d, j] = True
    return plane, good
