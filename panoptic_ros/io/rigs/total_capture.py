"""Read calibration.cal of the Total Capture data set (Trumble et al. 2017).

The file holds lines of numbers. The first line has the number of cameras and the number of lens terms. Each
camera then has first and last row and column of its images, fx fy cx cy in pixels, and the radial lens terms.
Three rows of the rotation and the translation in metres follow, camera from world. The world has y up.
Cameras have no names, so they are called cam1 and so on, like the videos. The reader follows public
descriptions of the format. It is tested on generated files, not on the data.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.errors import CalibrationError
from panoptic_ros.io.rigs.fields import camera
from panoptic_ros.io.rigs.options import ReadCameras, ReadOptions

Array = np.ndarray
# from the world of the data set (y up) to ours (z up)
Z_UP = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
LINES = (
    (4, "rows and columns"),
    (4, "fx fy cx cy"),
    (0, "terms of the lens"),
    (3, "rotation"),
    (3, "rotation"),
    (3, "rotation"),
    (3, "translation"),
)
MOST_TERMS = 3  # radial, k1 k2 k3


def recognises(rows: list[list[float]]) -> bool:
    """Return whether the lines of numbers begin with two integers, then four."""
    counts = [len(row) for row in rows[:3]]
    return counts == [2, 4, 4] and all(value.is_integer() for value in (*rows[0], *rows[1]))


def parse(rows: list[list[float]], options: ReadOptions) -> Rig:
    """Build a rig from the numbers of every line.

    Raises:
        CalibrationError: naming the line and the expected content.
    """
    number, terms = (int(value) for value in rows[0])
    if not 0 < number or not 0 <= terms <= MOST_TERMS:
        raise CalibrationError(f"line 1: {number} cameras, {terms} terms of the lens (at most {MOST_TERMS})")
    taken, line = ReadCameras(options), 1
    for k in range(number):
        parts = []
        for count, what in LINES:
            wanted = count or terms
            found = rows[line] if line < len(rows) else []
            if len(found) != wanted or not np.isfinite(found).all():
                raise CalibrationError(
                    f"line {line + 1}: {len(found)} numbers, expected {wanted}: {what} of camera {k + 1}"
                )
            parts.append(found)
            line += 1
        taken.take(f"cam{k + 1}", partial(_camera, f"cam{k + 1}", parts))
    if any(rows[line:]):
        raise CalibrationError(f"line {line + 1}: numbers behind the last of {number} cameras")
    return taken.rig()


def _camera(name: str, parts: list[list[float]]) -> Camera:
    first_row, last_row, first_column, last_column = parts[0]
    fx, fy, cx, cy = parts[1]
    matrix = np.array([[fx, 0.0, cx - first_column], [0.0, fy, cy - first_row], [0.0, 0.0, 1.0]])
    k1, k2, k3 = (*parts[2], 0.0, 0.0, 0.0)[:3]
    size = (int(last_column - first_column) + 1, int(last_row - first_row) + 1)
    rotation = np.array(parts[3:6]) @ Z_UP.T
    return camera(name, size, matrix, np.array([k1, k2, 0.0, 0.0, k3]), rotation, np.array(parts[6]))
