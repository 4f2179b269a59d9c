"""How far the cameras of a rig see past the fixed things in the room."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from panoptic_ros.domain import Camera, DetectionSet, Occluders, Rig, VisibilityLimit
from panoptic_ros.domain.visibility import LONGER_SIDE
from panoptic_ros.kernels import njit

Array = np.ndarray
MARGIN = 0.05  # m, how far calibrations and models of things are off
MIN_DEPTH = 1e-3  # m, as in the pinhole camera of `geometry`
SLACK = 1e-9  # of borders in the plane at 1 m

_jit = njit(cache=True, error_model="numpy")


def occluded_depths(camera: Camera, occluders: Occluders) -> Array:
    """Depths (H, W) m beyond which things hide all of a cell of the image; infinite where they do not.

    Rays through the corners of a cell tell: the farthest of their first surfaces counts, so cells across an
    edge see on, and things that are smaller than cells hide nothing.
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
    """The limits that the occluders of a rig set, by the names of its cameras; none of those who see all."""
    if rig.occluders is None:
        return {}
    depths = {camera.name: occluded_depths(camera, rig.occluders) for camera in rig.cameras}
    return {name: VisibilityLimit.of_depths(d, MARGIN) for name, d in depths.items() if np.isfinite(d).any()}


def limited(item: DetectionSet, limits: dict[str, VisibilityLimit]) -> DetectionSet:
    """The set with views that see no farther than these limits let them."""
    views = []
    for view in item.views:
        known = limits.get(view.camera)
        if known is not None:
            view = replace(view, limit=known if view.limit is None else known.combined(view.limit))
        views.append(view)
    return replace(item, views=tuple(views))


@_jit
def nearest_depths(plane, corners):
    """Depth (R, C) m of the first triangle that the rays (x, y, 1) of plane (R, C, 2) hit; inf where none.

    Args:
        plane: a grid, bent by a lens; NaN = no ray. corners: (M, 3, 3) m, of triangles in the camera's frame.
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
    """Least and largest x and y of a triangle (3, 3) in the plane at 1 m; any if it is not all in front."""
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
    """Depth at which the ray (x, y, 1) meets a triangle (3, 3); inf if it does not."""
    a, b, c = triangle
    p, q, r = _volume(a, b, x, y), _volume(b, c, x, y), _volume(c, a, x, y)
    if not ((p >= 0.0 and q >= 0.0 and r >= 0.0) or (p <= 0.0 and q <= 0.0 and r <= 0.0)):
        return np.inf
    total = p + q + r  # weights of the corners opposite to the edges; the ray meets their mean
    depth = (p * c[2] + q * a[2] + r * b[2]) / total
    return depth if depth > MIN_DEPTH else np.inf


@_jit
def _volume(a, b, x, y):
    """(a x b) . (x, y, 1): on which side of the plane through the camera, a and b a ray is."""
    return (a[1] * b[2] - a[2] * b[1]) * x + (a[2] * b[0] - a[0] * b[2]) * y + a[0] * b[1] - a[1] * b[0]
