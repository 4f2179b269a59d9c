"""Compiled kernels that tell which 2D peaks known joints explain."""
from __future__ import annotations

import math

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.voting.kernels import hidden, project

CELLS = 2.0  # of a score map, within which a joint explains a peak
REACH = 0.06  # m, the same where a person is large in the image
WIDTHS = 1.5  # the same for keypoints, in standard deviations of their Gaussians

_jit = njit(cache=True, error_model="numpy", nogil=True)


@_jit
def unexplained_peaks(scene, start, pixels, joints, points, shifts, delays):
    """Which peaks (K,) are not near to where a joint of their kind is seen.

    Args:
        start, pixels: of `find_peaks`.
        joints: (N,); points: (N, 3) m at the instant, shifts: (N, 3) m/s. delays: (V,) s.
    """
    cameras, people, map_start = scene.cameras, scene.people, scene.map_start
    left = np.ones(len(pixels), np.bool_)
    for v in range(len(cameras)):
        camera = cameras[v]
        focal = max(camera.fx, camera.fy)
        cell = 1.0 / math.hypot(camera.a0, camera.a1) if camera.columns > 0.0 else 0.0
        for n in range(len(points)):
            j = joints[n]
            first, last = start[v * map_start.shape[1] + j], start[v * map_start.shape[1] + j + 1]
            if first == last:
                continue
            x = points[n, 0] + shifts[n, 0] * delays[v]
            y = points[n, 1] + shifts[n, 1] * delays[v]
            z = points[n, 2] + shifts[n, 2] * delays[v]
            u, w, _, _, covered = project(cameras, v, x, y, z)
            far = _distance(camera, x, y, z)
            if not covered or hidden(cameras, scene.limits, v, x, y, z, u, w):
                continue
            for k in range(first, last):
                near = max(REACH * focal / far, CELLS * cell)
                if map_start[v, j] < 0:
                    near = max(REACH * focal / far, WIDTHS * _width(people[v, j], pixels[k]))
                dx, dy = pixels[k, 0] - u, pixels[k, 1] - w
                if dx * dx + dy * dy <= near * near:
                    left[k] = False
    return left


@_jit
def _distance(camera, x, y, z):
    """How far away a world point is for the size that a thing there has in the image, m."""
    depth = camera.r20 * x + camera.r21 * y + camera.r22 * z + camera.tz
    if camera.fisheye > 0.0:  # sizes go by angles
        across = camera.r00 * x + camera.r01 * y + camera.r02 * z + camera.tx
        down = camera.r10 * x + camera.r11 * y + camera.r12 * z + camera.ty
        return math.sqrt(across * across + down * down + depth * depth)
    return depth


@_jit
def _width(people, pixel):
    """Standard deviation of the keypoint (P, 4) at a pixel."""
    for i in range(len(people)):
        if people[i, 0] == pixel[0] and people[i, 1] == pixel[1]:
            return math.sqrt(0.5 / people[i, 2])
    return 0.0
