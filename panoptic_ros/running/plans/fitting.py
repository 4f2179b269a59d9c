"""Adapts a rig to images that are binned or cropped according to CameraInfo, or that have another size."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from panoptic_ros.capture.image_size import SizePolicy, fit_camera, is_exchanged, size_change
from panoptic_ros.domain import Camera, Rig
from panoptic_ros.domain.rig import lines_of
from panoptic_ros.errors import CalibrationError, DataError
from panoptic_ros.io.bag_streams import BagStream
from panoptic_ros.io.bags import BagReader
from panoptic_ros.io.messages.camera_infos import INFO, as_published, info_topic, published_size, whole_size


def fit_to_info(camera: Camera, info: Any, what: str) -> tuple[Camera, str]:
    """Return the camera of raw images as published by the driver: binned, or of a region (REP 104).

    Args:
        camera: the camera in the rig, calibrated for the whole sensor or for these images.
        info: CameraInfo. A size of 0 x 0 changes nothing.
        what: kind of the images, for messages.

    Returns:
        the camera, and a text about the change, or "".

    Raises:
        CalibrationError: if the rig is calibrated for another size.
    """
    size = published_size(info)
    if whole_size(info) == (0, 0) or camera.image_size == size:
        return camera, ""
    if is_exchanged(camera, size):
        return replace(camera, image_size=size), size_change(camera, size, "strict")
    check_size(camera, info, what)
    (width, height), (columns, rows) = camera.image_size, size
    return as_published(camera, info), (
        f"CameraInfo states that {what} of {columns}x{rows} are binned or cropped from {width}x{height}; "
        "the calibration is adapted"
    )


def check_size(camera: Camera, info: Any, what: str) -> None:
    """Check that a camera is calibrated for the whole sensor of its driver.

    Raises:
        CalibrationError: if it is not.
    """
    if whole_size(info) != camera.image_size:
        sizes = [f"{width} x {height}" for width, height in (published_size(info), camera.image_size)]
        raise CalibrationError(
            f"camera {camera.name} publishes {what} of {sizes[0]}, but the rig is calibrated for {sizes[1]}"
        )


def fit_to_bags(
    rig: Rig, bag_of: Mapping[BagStream, BagReader], bags: Sequence[BagReader], policy: SizePolicy
) -> tuple[Rig, tuple[str, ...]]:
    """Return the rig with its cameras adapted to the image sizes in bags.

    A camera is adapted by the CameraInfo beside its images if that fits, else by the policy.

    Args:
        bag_of: bag by stream of images or detections. The streams identify the cameras of the rig.
        bags: bags that may contain CameraInfo.
        policy: see `fit_camera`.

    Returns:
        the rig, and lines about the changes.

    Raises:
        DataError: if the policy refuses the image size of a camera.
    """
    fitted, told = {camera.name: camera for camera in rig.cameras}, list[tuple[str, str]]()
    for stream, bag in bag_of.items():
        camera, size = fitted[stream.camera], stream.first_record(bag).image_size
        if size == camera.image_size:
            continue
        info = _first_info(bags, info_topic(stream.topic))
        if info is not None and published_size(info) == size and whole_size(info) == camera.image_size:
            fitted[stream.camera], change = fit_to_info(camera, info, "images")
            told.append((stream.camera, change))
            continue
        try:
            fitted[stream.camera] = fit_camera(camera, size, policy)
        except CalibrationError as error:
            raise DataError(f"{stream.bag}, topic {stream.topic}: {error}") from None
        told.append((stream.camera, size_change(camera, size, policy)))
    return replace(rig, cameras=tuple(fitted.values())), lines_of(told)


def _first_info(bags: Sequence[BagReader], topic: str) -> Any:
    """Return the first message of a CameraInfo topic; None if there is none."""
    for bag in bags:
        if bag.topics.get(topic) == INFO:
            return next((message for _, _, message in bag.messages(topic)), None)
    return None
