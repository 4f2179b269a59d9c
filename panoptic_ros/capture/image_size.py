"""Does a rig fit the images, and what can be done where it does not."""
from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from panoptic_ros.domain import Camera
from panoptic_ros.errors import CalibrationError
from panoptic_ros.geometry import Intrinsics

SizePolicy = Literal["strict", "scale", "crop"]
ASPECT_TOLERANCE = 0.005


def fit_camera(camera: Camera, image_size: tuple[int, int], policy: SizePolicy = "strict") -> Camera:
    """The camera for images of another size than the calibration's.

    Args:
        camera: as calibrated.
        image_size: (width, height) px of the images.
        policy: "strict" refuses any difference; "scale": the images were resized, focal lengths and
            principal point are scaled, if the aspect is the same to 0.5 %; "crop": columns were
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
        return replace(camera, image_size=image_size, intrinsics=_scaled(camera.intrinsics, scale_x, scale_y))
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
        return "if the encoder cut or padded the right or lower border, allow it with the size policy 'crop'"
    return "use the rig that belongs to these videos"


def _scaled(intrinsics: Intrinsics, scale_x: float, scale_y: float) -> Intrinsics:
    """Resizing keeps the image's borders, which lie half a pixel outside of the centres of pixels."""
    scale = np.diag([scale_x, scale_y, 1.0])
    half = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])
    return Intrinsics(np.linalg.inv(half) @ scale @ half @ intrinsics.matrix, intrinsics.distortion)
