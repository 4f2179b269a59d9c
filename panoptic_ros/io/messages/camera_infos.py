"""Convert sensor_msgs/CameraInfo (REP 104) to cameras and back: lenses, rectified images, binning, ROI."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from panoptic_ros.domain import Camera
from panoptic_ros.errors import CalibrationError, DataError
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.io.distortion_models import read_lens, ros_name
from panoptic_ros.io.messages.family import MessageFamily
from panoptic_ros.io.messages.images import optical_frame

INFO = "sensor_msgs/msg/CameraInfo"
PACKED = ("/compressedDepth", "/compressed")  # suffixes of transports, appended to the topic of raw images


def plain_topic(topic: str) -> str:
    """Return an image topic without the suffix of a transport."""
    for ending in PACKED:
        topic = topic.removesuffix(ending)
    return topic


def info_topic(image_topic: str) -> str:
    """Return the CameraInfo topic of an image topic: `camera_info` in the same namespace."""
    return f"{plain_topic(image_topic).rsplit('/', 1)[0]}/camera_info"


def camera_from_info(message: Any, name: str, cam_from_world: Rigid) -> Camera:
    """Return the camera of the raw images that a CameraInfo describes.

    Raises:
        DataError: as `whole_camera`.
    """
    camera, _ = whole_camera(message, name, cam_from_world)
    return as_published(camera, message)


def whole_camera(message: Any, name: str, cam_from_world: Rigid) -> tuple[Camera, str]:
    """Return the camera of raw images of the whole sensor, and a notice about an assumption, or "".

    Raises:
        DataError: if it is not calibrated, or its lens model is not supported.
    """
    matrix = np.array(message.k, float).reshape(3, 3)
    if not matrix.any():
        raise DataError(f"camera_info of {name} is all 0: its driver is not calibrated")
    size = whole_size(message)
    if size == (0, 0):
        raise DataError(f"camera_info of {name} states images of 0 x 0: its driver is not calibrated")
    try:
        lens, terms, assumed = read_lens(str(message.distortion_model), np.array(message.d, float))
        camera = Camera(name, size, Intrinsics(matrix, terms, lens), cam_from_world)
    except CalibrationError as error:
        raise DataError(f"camera_info of {name}: {str(error).removeprefix(f'camera {name}: ')}") from None
    return camera, assumed and f"camera_info of {name}: {assumed}"


def rectified(camera: Camera, message: Any) -> Camera:
    """Return the camera of the rectified images of the same lens: no distortion, with K and R of CameraInfo.

    Raises:
        DataError: if the message has no projection matrix.
    """
    matrix = np.array(message.p, float).reshape(3, 4)[:, :3]
    if not matrix.any():
        raise DataError(f"camera_info of {camera.name} has no projection: its images cannot be rectified")
    rotation = np.array(message.r, float).reshape(3, 3)
    turned = Rigid(rotation if rotation.any() else np.eye(3), np.zeros(3))
    pose = turned.compose(camera.cam_from_world)
    return replace(camera, intrinsics=Intrinsics(matrix, np.zeros(0)), cam_from_world=pose, covariance=None)


def whole_size(message: Any) -> tuple[int, int]:
    """Return the size (width, height) px of the whole sensor, to which the calibration refers."""
    return int(message.width), int(message.height)


def published_size(message: Any) -> tuple[int, int]:
    """Return the size (width, height) px of the published images after region of interest and binning."""
    _, _, width, height = _region(message)
    across, down = _binning(message)
    return width // across, height // down


def as_published(camera: Camera, message: Any) -> Camera:
    """Return the camera of the published images, from that of the whole sensor, by region and binning."""
    size = published_size(message)
    if size == camera.image_size:
        return camera
    left, top, _, _ = _region(message)
    across, down = _binning(message)
    return camera.resized(size, (1.0 / across, 1.0 / down), (-left / across, -top / down))


def _region(message: Any) -> tuple[int, int, int, int]:
    """Return left and top border, width and height of the region of interest, px of the whole sensor."""
    roi, (width, height) = message.roi, whole_size(message)
    left, top = int(roi.x_offset), int(roi.y_offset)
    return left, top, int(roi.width) or width - left, int(roi.height) or height - top


def _binning(message: Any) -> tuple[int, int]:
    """Return the sensor pixels per image pixel along x and y; a binning of 0 means 1."""
    return max(int(message.binning_x), 1), max(int(message.binning_y), 1)


def camera_info_message(camera: Camera, stamp_ns: int, family: MessageFamily) -> Any:
    """Build the CameraInfo of one image, with model plumb_bob, rational_polynomial or equidistant."""
    k = np.array(camera.intrinsics.matrix)
    roi = family.make(
        "sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
    )
    return family.make(
        INFO,
        header=family.header(stamp_ns, optical_frame(camera.name)),
        height=camera.image_size[1],
        width=camera.image_size[0],
        distortion_model=ros_name(camera.intrinsics),
        d=family.sequence(np.array(camera.intrinsics.distortion)),
        k=k.reshape(9),
        r=np.eye(3).reshape(9),
        p=np.hstack([k, np.zeros((3, 1))]).reshape(12),
        binning_x=0,
        binning_y=0,
        roi=roi,
    )
