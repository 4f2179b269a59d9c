"""Visibility limits of cameras from the fixed objects in the room."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from panoptic_ros.domain import Camera, DetectionSet, Occluders, Rig, VisibilityLimit
from panoptic_ros.domain.visibility import LONGER_SIDE
from panoptic_ros.kernels import njit

Array = np.ndarray
MARGIN = 0.05  # m, error of calibrations and of the objects' models
MIN_DEPTH = 1e-3  # m, least depth in front of a camera, as in `geometry.pinhole`
SLACK = 1e-9  # tolerance of borders on the plane at 1 m

_jit = njit(cache=True, error_model="numpy")


def occluded_depths(camera: Camera, occluders: Occluders) -> Array:
    """Return the depths (H, W) m beyond which objects hide all of an image cell; infinite where they do not.

    The limit of a cell is the farthest first hit of the rays through its corners. So a cell across an edge is
    limited only by the surface behind. Objects smaller than a cell hide nothing.
    """
    size = np.array(camera.image_size)
    columns, rows = np.maximum(1, np.round(size * min(1.0, LONGER_SIDE / size.max())).astype(int))
    u = np.arange(columns + 1) * (size[0] / columns) - 0.5
    w = np.arange(rows + 1) * (size[1] / rows) - 0.5
    plane = camera.intrinsics.undistort(np.stack(np.meshgrid(u, w), axis=-1))
    vertices = camera.cam_from_world.apply(occluders.vertices)
    depths = nearest_depths(plane, vertices[occluders.triangles])
    depths = np.maximum(depths[1:], depths[:-1])
    farthest: Array = np.maximum(depths[:, 1:], depths[:, :-1])
    return farthest


def limits_of_rig(rig: Rig) -> dict[str, VisibilityLimit]:
    """Return the limits that a rig's occluders set, by camera name; a camera without limits has no entry."""
    if rig.occluders is None:
        return {}
    depths = {camera.name: occluded_depths(camera, rig.occluders) for camera in rig.cameras}
    return {name: VisibilityLimit.of_depths(d, MARGIN) for name, d in depths.items() if np.isfinite(d).any()}


def limited(item: DetectionSet, limits: dict[str, VisibilityLimit]) -> DetectionSet:
    """Return the set with these limits added to the limits of its views."""
    views = []
    for view in item.views:
        known = limits.get(view.camera)
        if known is not None:
            view = replace(view, limit=known if view.limit is None else known.combined(view.limit))
        views.append(view)
    return replace(item, views=tuple(views))


@_jit
def nearest_depths(plane, corners):
    """Return the depth (R, C) m of the nearest triangle on each ray; infinite where there is none.

    Args:
        plane: (R, C, 2) rays (x, y, 1), a grid that a lens distorts; NaN = no ray.
        corners: (M, 3, 3) m, corners of the triangles in the camera's frame.
    """
    nearest = np.full(plane.shape[:2], np.inf)
    for m in range(len(corners)):
        left, right, top, bottom = _box(corners[m])
        for r in range(plane.shape[0]):
            for c in range(plane.shape[1]):
                x, y = plane[r, c, 0], plane[r, c, 1]
                if (x >= left) & (x <= right) & (y >= top) & (y <= bottom):
                    depth = _hit(corners[m], x, y)
                    if depth < nearest[r, c]:
                        nearest[r, c] = depth
    return nearest


@_jit
def _box(triangle):
    """Return the bounds of a triangle (3, 3) m on the plane at 1 m; infinite unless it is all in front.

    Returns:
        least x, greatest x, least y, greatest y.
    """
    left = top = np.inf
    right = bottom = -np.inf
    for k in range(3):
        x, y, z = triangle[k, 0], triangle[k, 1], triangle[k, 2]
        if z <= MIN_DEPTH:
            return -np.inf, np.inf, -np.inf, np.inf
        left, right = min(left, x / z - SLACK), max(right, x / z + SLACK)
        top, bottom = min(top, y / z - SLACK), max(bottom, y / z + SLACK)
    return left, right, top, bottom


@_jit
def _hit(triangle, x, y):
    """Return the depth at which the ray (x, y, 1) meets a triangle (3, 3) m; infinite if it does not."""
    a, b, c = triangle
    p, q, r = _volume(a, b, x, y), _volume(b, c, x, y), _volume(c, a, x, y)
    if not ((p >= 0.0 and q >= 0.0 and r >= 0.0) or (p <= 0.0 and q <= 0.0 and r <= 0.0)):
        return np.inf
    total = p + q + r  # p, q and r are the weights of c, a and b in the point that the ray meets
    depth = (p * c[2] + q * a[2] + r * b[2]) / total
    return depth if depth > MIN_DEPTH else np.inf


@_jit
def _volume(a, b, x, y):
    """Return (a x b) . (x, y, 1), whose sign is the ray's side of the plane through the camera, a and b."""
    return (a[1] * b[2] - a[2] * b[1]) * x + (a[2] * b[0] - a[0] * b[2]) * y + a[0] * b[1] - a[1] * b[0]
