"""Check whether a calibration fits the image size, and adapt it by a policy if it does not."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from panoptic_ros.domain import Camera
from panoptic_ros.errors import CalibrationError

SizePolicy = Literal["strict", "scale", "letterbox", "crop"]
ASPECT_TOLERANCE = 0.005
# largest offset of the principal point from the image centre, relative to that in the stated size
FITS_BETTER = 0.5
BARS = "if they have black bars, with 'letterbox'"


def fit_camera(camera: Camera, image_size: tuple[int, int], policy: SizePolicy = "strict") -> Camera:
    """Return the camera for images of another size than the calibration's.

    Args:
        camera: Calibrated camera.
        image_size: (width, height) px of the images.
        policy: Treatment of a different size. "strict" refuses it, except if width and height were swapped by
            mistake (see `is_exchanged`). With "scale", images were resized: focal lengths and principal point
            are scaled, and the aspect ratio must agree to 0.5 %. With "letterbox", images were resized with
            constant aspect ratio and padded with equal bars on two sides. With "crop", columns were removed
            or added at the right, and rows at the bottom. Pixels then keep their coordinates and only the
            size changes. Video encoders with blocks of 16 px do that: 1080 or 1088.

    Raises:
        CalibrationError: naming both sizes and a possible reason.
    """
    if camera.image_size == tuple(image_size):
        return camera
    if is_exchanged(camera, image_size):
        return replace(camera, image_size=image_size)
    (width, height), (new_width, new_height) = camera.image_size, image_size
    scale_x, scale_y = new_width / width, new_height / height
    same_aspect = abs(scale_x / scale_y - 1.0) <= ASPECT_TOLERANCE
    if policy == "crop" and abs(new_width - width) < 16 and abs(new_height - height) < 16:
        return replace(camera, image_size=image_size)
    if policy == "scale" and same_aspect:
        return camera.resized(image_size, (scale_x, scale_y))
    if policy == "letterbox":
        scale = min(scale_x, scale_y)
        bars = (0.5 * (new_width - scale * width), 0.5 * (new_height - scale * height))
        return camera.resized(image_size, (scale, scale), bars)
    raise CalibrationError(
        f"camera {camera.name}: images are {new_width}x{new_height} but the rig states {width}x{height}; "
        + _advice(camera.image_size, image_size, same_aspect)
    )


def is_exchanged(camera: Camera, image_size: tuple[int, int]) -> bool:
    """Return whether the rig swaps width and height of the images, with no other difference.

    The principal point is then much closer to the centre of the images than to that of the stated size.
    """
    if camera.image_size != tuple(image_size)[::-1]:
        return False
    return _off_centre(camera, image_size) < FITS_BETTER * _off_centre(camera, camera.image_size)


def _off_centre(camera: Camera, size: tuple[int, int]) -> float:
    """Return the offset of the principal point from the centre, relative to the size, the larger axis."""
    cx, cy = camera.intrinsics.matrix[:2, 2]
    return float(max(abs(cx / size[0] - 0.5), abs(cy / size[1] - 0.5)))


def size_change(camera: Camera, image_size: tuple[int, int], policy: SizePolicy) -> str:
    """Describe how `fit_camera` adapts a camera; "" if the sizes are equal."""
    if camera.image_size == tuple(image_size):
        return ""
    stated, found = (f"{width}x{height}" for width, height in (camera.image_size, image_size))
    if is_exchanged(camera, image_size):
        return (
            f"the rig states {stated}, but its principal point is in the middle of {found}, the size of "
            "the images: width and height of the rig are taken as exchanged"
        )
    return f"calibrated at {stated}, images are {found}: {policy}"


def _advice(rig_size: tuple[int, int], image_size: tuple[int, int], same_aspect: bool) -> str:
    if image_size == rig_size[::-1]:
        return "width and height are exchanged: turn the video, or calibrate the camera as it was filmed"
    if same_aspect:
        return "if the video was resized after calibration, allow it with the size policy 'scale'"
    if all(abs(a - b) < 16 for a, b in zip(rig_size, image_size)):
        return "if the encoder cut the right or lower border, allow it with the size policy 'crop'; " + BARS
    return f"use the rig that belongs to these videos; {BARS}"
