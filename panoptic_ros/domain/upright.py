"""Up direction in images: the roll of cameras about their optical axes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from panoptic_ros.domain.camera import Camera
from panoptic_ros.errors import CalibrationError, shown

Array = np.ndarray
Direction = tuple[float, float, float]  # unit vector
Z_UP: Direction = (0.0, 0.0, 1.0)
STEEP = 0.25  # sine of the angle between optical axis and vertical, below which an image has no top
SPREAD = 0.05  # mean square of the image rows across their main axis, below which the rows are parallel


def direction(up: Sequence[float]) -> Direction:
    """Return an up direction at unit length; one whose length is 1 to 1e-9 is kept bit for bit.

    Raises:
        CalibrationError: if it is not three finite numbers, or has length 0.
    """
    values = [float(value) for value in up]
    length = math.hypot(*values)
    if len(values) != 3 or not 0.0 < length < math.inf:
        raise CalibrationError(f"up direction of the rig: {shown(values)}, expected three numbers, not all 0")
    x, y, z = values if abs(length - 1.0) < 1e-9 else [value / length for value in values]
    return x, y, z


def roll_of(camera: Camera, up: Sequence[float]) -> float:
    """Return the rotation, degrees counter-clockwise in (-180, 180], that makes a camera's image upright.

    It is 0 for a camera that looks almost straight up or down.

    Args:
        up: Unit vector (3,) of the world.
    """
    across, down, _ = (camera.cam_from_world.rotation @ np.asarray(up, np.float64)).tolist()
    if math.hypot(across, down) < STEEP:
        return 0.0
    degrees = math.degrees(math.atan2(across, -down))
    return 180.0 if degrees <= -180.0 else degrees


def up_of_images(
    cameras: Sequence[Camera], clockwise: Sequence[int], spread: float = SPREAD
) -> Direction | None:
    """Find the world's up direction from images that quarter turns make upright.

    It is +z if +z agrees with all images. Otherwise it is the direction at right angles to the rows of the
    turned images, because level cameras have horizontal rows.

    Args:
        clockwise: Quarter turns of the image of each camera.
        spread: See `SPREAD`.

    Returns:
        None if the cameras agree on no direction, or if their rows are parallel.
    """
    rows, tops = np.zeros((2, len(cameras), 3))
    for i, (camera, turns) in enumerate(zip(cameras, clockwise)):
        right, down, _ = camera.cam_from_world.rotation
        sides = (right, -down, -right, down)
        rows[i], tops[i] = sides[turns % 4], sides[(turns + 1) % 4]
    if _agree(rows, tops, np.array(Z_UP)):
        return Z_UP
    values, vectors = np.linalg.eigh(rows.T @ rows)
    up = vectors[:, 0] * (-1.0 if (tops @ vectors[:, 0]).sum() < 0.0 else 1.0)
    if values[1] < spread * len(cameras) or not _agree(rows, tops, up):
        return None
    x, y, z = up.tolist()
    return x, y, z


def _agree(rows: Array, tops: Array, up: Array) -> bool:
    """Return whether images with rows and tops (C, 3) in the world are upright within 45 degrees.

    Cameras that look almost along `up` are always treated as upright.
    """
    across, along = rows @ up, tops @ up
    return bool(((along > np.abs(across)) | (np.hypot(across, along) < STEEP)).all())
