"""Does a rig fit the images, and what can be done where it does not."""
from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from panoptic_ros.domain import Camera
from panoptic_ros.errors import CalibrationError

Array = np.ndarray
SizePolicy = Literal["strict", "scale", "letterbox", "crop"]
ASPECT_TOLERANCE = 0.005
BARS = "if they have black bars, with 'letterbox'"


def fit_camera(camera: Camera, image_size: tuple[int, int], policy: SizePolicy = "strict") -> Camera:
    """The camera for images of another size than the calibration's.

    Args:
        camera: as calibrated.
        image_size: (width, height) px of the images.
        policy: "strict" refuses any difference; "scale": the images were resized, focal lengths and
            principal point are scaled, if the aspect is the same to 0.5 %; "letterbox": they were resized
            to fit, keeping the aspect, and padded with equal bars on two sides; "crop": columns were
            cut off or added at the right, rows at the bottom (as video encoders do that work in blocks of
            16 px: 1080 or 1088), so that pixels keep their coordinates and only the size changes.

    Raises:
        CalibrationError: naming both sizes and what may have happened.
    """
    if camera.image_size == tuple(image_size):
        return camera
    (width, height), (new_width, new_height) = camera.image_size, image_size
    scale_x, scale_y = new_width / width, new_height / height
    same_aspect = abs(scale_x / scale_y - 1.0) <= ASPECT_TOLERANCE
    if policy == "crop" and abs(new_width - width) < 16 and abs(new_height - height) < 16:
        return replace(camera, image_size=image_size)
    if policy == "scale" and same_aspect:
        return _resized(camera, image_size, (scale_x, scale_y), (0.0, 0.0))
    if policy == "letterbox":
        scale = min(scale_x, scale_y)
        bars = (0.5 * (new_width - scale * width), 0.5 * (new_height - scale * height))
        return _resized(camera, image_size, (scale, scale), bars)
    raise CalibrationError(
        f"camera {camera.name}: images are {new_width}x{new_height} but the rig says {width}x{height}; "
        + _advice(camera.image_size, image_size, same_aspect)
    )


def _advice(rig_size: tuple[int, int], image_size: tuple[int, int], same_aspect: bool) -> str:
    if image_size == rig_size[::-1]:
        return "width and height are exchanged: turn the video, or calibrate the camera as it was filmed"
    if same_aspect:
        return "if the video was resized after calibration, allow it with the size policy 'scale'"
    if all(abs(a - b) < 16 for a, b in zip(rig_size, image_size)):
        return "if the encoder cut the right or lower border, allow it with the size policy 'crop'; " + BARS
    return f"use the rig that belongs to these videos; {BARS}"


def _resized(
    camera: Camera, image_size: tuple[int, int], scale: tuple[float, float], bars: tuple[float, float]
) -> Camera:
    """Resizing keeps the image's borders, which lie half a pixel outside of the centres of pixels.

    bars: px that are then added at the left and at the top. The sensor reads its rows as before, so the
    delay between rows of the image changes.
    """
    half = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])
    move = np.array([[scale[0], 0.0, bars[0]], [0.0, scale[1], bars[1]], [0.0, 0.0, 1.0]])
    matrix = np.linalg.inv(half) @ move @ half @ camera.intrinsics.matrix
    covariance = None if camera.covariance is None else _scaled_covariance(camera.covariance, scale)
    return replace(
        camera, image_size=image_size, intrinsics=replace(camera.intrinsics, matrix=matrix),
        covariance=covariance, line_delay_us=camera.line_delay_us / scale[1],
    )  # fmt: skip


def _scaled_covariance(covariance: Array, scale: tuple[float, float]) -> Array:
    """The covariance of a camera whose fx, fy, cx, cy have been scaled."""
    factors = np.ones(len(covariance))
    factors[6:10] = scale * 2
    scaled: Array = covariance * np.outer(factors, factors)
    return scaled
