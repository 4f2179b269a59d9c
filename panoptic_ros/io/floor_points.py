"""Read points on the floor that are marked in images: a CSV file with columns point, camera, x, y."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from panoptic_ros.domain import Rig
from panoptic_ros.errors import DataError
from panoptic_ros.io.loading import parsing, read_bytes

COLUMNS = ("point", "camera", "x", "y")


def read_floor_points(path: Path, rig: Rig) -> tuple[tuple[str, ...], np.ndarray]:
    """Return the names (N,) of points in the order of the file, and pixels (N, C, 2) px, NaN = not marked.

    Raises:
        DataError: naming a missing column, a value that is no number, or a camera that is not in the rig.
    """
    rows = csv.DictReader(read_bytes(path).decode("utf-8-sig", "replace").splitlines())
    missing = [name for name in COLUMNS if name not in (rows.fieldnames or ())]
    if missing:
        raise DataError(f"{path}: no column {missing[0]}; columns are {', '.join(COLUMNS)}")
    marks: dict[str, dict[str, tuple[float, float]]] = {}
    with parsing(path):
        for row in rows:
            if row["camera"] not in rig.names:
                raise DataError(f"{path}: unknown camera {row['camera']}; cameras are {', '.join(rig.names)}")
            own = marks.setdefault(row["point"], {})
            if row["camera"] in own:
                raise DataError(f"{path}: point {row['point']} is marked twice in camera {row['camera']}")
            own[row["camera"]] = float(row["x"]), float(row["y"])
    pixels = np.full((len(marks), len(rig), 2), np.nan)
    for n, own in enumerate(marks.values()):
        for camera, pixel in own.items():
            pixels[n, rig.index(camera)] = pixel
    return tuple(marks), pixels
