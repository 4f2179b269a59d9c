"""The compiled loop of `known_occluders`. It calls nothing outside of this file."""
from __future__ import annotations

import numpy as np
from numba import njit

MIN_DEPTH = 1e-3  # m, as in the pinhole camera of `geometry`


@njit(cache=True, error_model="numpy")
def nearest_depths(plane, corners):
    """Depth (N,) m of the first triangle that the rays (x, y, 1) of plane (N, 2) hit; inf where none.

    Args:
        corners: (M, 3, 3) m, of the triangles in the camera's frame.
    """
    nearest = np.full(len(plane), np.inf)
    for m in range(len(corners)):
        a, b, c = corners[m]
        normal = np.cross(b - a, c - a)
        offset = normal[0] * a[0] + normal[1] * a[1] + normal[2] * a[2]
        edges = np.empty((3, 3))  # planes through the camera and an edge each
        edges[0], edges[1], edges[2] = np.cross(a, b), np.cross(b, c), np.cross(c, a)
        for n in range(len(plane)):
            x, y = plane[n, 0], plane[n, 1]
            p = edges[0, 0] * x + edges[0, 1] * y + edges[0, 2]
            q = edges[1, 0] * x + edges[1, 1] * y + edges[1, 2]
            r = edges[2, 0] * x + edges[2, 1] * y + edges[2, 2]
            if not ((p >= 0.0 and q >= 0.0 and r >= 0.0) or (p <= 0.0 and q <= 0.0 and r <= 0.0)):
                continue
            depth = offset / (normal[0] * x + normal[1] * y + normal[2])
            if MIN_DEPTH < depth < nearest[n]:
                nearest[n] = depth
    return nearest
