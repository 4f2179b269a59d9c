"""Coarse depth buffer: the surfaces that depth sensors measure, as another camera sees them; compiled.

It serves only to look up points on people, with a tolerance of centimetres. So maps need not have the instant
of the image, nor be registered to it, and cells of a few pixels suffice.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import Camera
from panoptic_ros.kernels import njit

Array = np.ndarray
CELL_PX = 4.0  # px of the camera's image, size of a cell
COLUMNS = 160  # columns of a map that are used; wider maps are subsampled
NEAREST = 0.1  # m, least depth that counts


def ready() -> None:
    """Compile the kernels, or load them from the cache."""
    eye, depth = np.eye(3), np.ones((2, 2), np.float32)
    depth.flags.writeable = False  # read-only, as maps are
    splat(depth, np.zeros((2, 2, 2)), 1, eye, np.zeros(3), np.zeros(2), 1.0, np.ones((2, 2)))


class SensorDepthMap(NamedTuple):
    """Map of a depth sensor: (h, w) m along its z axis, 0 = unknown."""

    camera: Camera  # camera of the sensor
    plane: Array  # (h, w, 2) its pixels on the plane at distance 1
    depth: Array


class DepthBuffer:
    """Nearest measured surface in each cell of a camera's image."""

    def __init__(self, camera: Camera):
        self._pose = camera.cam_from_world
        width, height = camera.image_size
        border = [(x, y) for x in (0.0, width - 1.0) for y in (0.0, height - 1.0)]
        corners = camera.intrinsics.undistort(np.array(border)).reshape(-1, 2)
        corners = corners[np.isfinite(corners).all(axis=1)]
        matrix = camera.intrinsics.matrix
        self._cell = CELL_PX / float(min(matrix[0, 0], matrix[1, 1]))
        self._low = corners.min(axis=0)
        columns, rows = np.ceil((corners.max(axis=0) - self._low) / self._cell).astype(int) + 1
        self._shape = (int(rows), int(columns))

    def drawn(self, maps: Sequence[SensorDepthMap]) -> Array:
        """Return the cells (R, C) m for these maps, infinite where nothing is known."""
        cells, pose = np.full(self._shape, np.inf), self._pose
        for sensed in maps:
            other = sensed.camera.cam_from_world
            turn = pose.rotation @ other.rotation.T
            shift = pose.translation - turn @ other.translation
            step = max(1, round(sensed.depth.shape[1] / COLUMNS))
            splat(sensed.depth, sensed.plane, step, turn, shift, self._low, self._cell, cells)
        return cells

    def depths(self, cells: Array, plane: Array) -> Array:
        """Return the depths (N,) m of the nearest surface at points (N, 2) of the plane; inf = unknown."""
        at = np.floor((plane - self._low) / self._cell).astype(int)
        inside = ((at >= 0) & (at < cells.shape[::-1])).all(axis=1)
        found = np.full(len(plane), np.inf)
        found[inside] = cells[at[inside, 1], at[inside, 0]]
        return found


@njit(cache=True, error_model="numpy", nogil=True)
def splat(depth, plane, step, turn, shift, low, cell, cells):
    """Draw every `step`-th pixel of a map into cells (R, C) m of another camera; nearer surfaces stay.

    Args:
        turn, shift: camera_from_sensor.
        low: (2,) position of the first cell on the plane.
        cell: Size of a cell on the plane.
    """
    point = np.empty(3)
    for y in range(0, depth.shape[0], step):
        for x in range(0, depth.shape[1], step):
            z = depth[y, x]
            if not z > NEAREST:  # also False for NaN
                continue
            for i in range(3):
                ray = turn[i, 0] * plane[y, x, 0] + turn[i, 1] * plane[y, x, 1] + turn[i, 2]
                point[i] = shift[i] + z * ray
            if not point[2] > NEAREST:
                continue
            column = int(np.floor((point[0] / point[2] - low[0]) / cell))
            row = int(np.floor((point[1] / point[2] - low[1]) / cell))
            if 0 <= row < cells.shape[0] and 0 <= column < cells.shape[1]:
                cells[row, column] = min(cells[row, column], point[2])
