"""Plans of live runs on topics of running drivers."""
from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.errors import CalibrationError, DataError
from panoptic_ros.io.driver_topics import DriverTopics, read_driver_topics
from panoptic_ros.io.messages.images import ENCODINGS, camera_from_info, rectified
from panoptic_ros.io.rigs import read_rig
from panoptic_ros.nodes.drivers import Drivers, find_drivers
from panoptic_ros.running.options import NO_OPTIONS, RunOptions
from panoptic_ros.running.parameters import Parameters, with_defaults
from panoptic_ros.running.plan import Plan, require_two
from panoptic_ros.running.processes import prepare_environment

CARRIERS = {
    ("image", "sensor_msgs/msg/Image"): "image",
    ("image", "sensor_msgs/msg/CompressedImage"): "compressed_image",
    ("depth", "sensor_msgs/msg/Image"): "depth",
    ("depth", "sensor_msgs/msg/CompressedImage"): "compressed_depth",
    ("camera_info", "sensor_msgs/msg/CameraInfo"): "camera_info",
}
RECTIFIED = "_rect"  # in the last words of a topic's name, as image_proc and drivers call them
SAME_FOCAL = 0.01  # relative: what CameraInfo and the rig may differ by


def plan_drivers(path: Path, rig: Path, options: RunOptions = NO_OPTIONS) -> Plan:
    """The plan of a live run on what drivers publish.

    Args:
        path: of the topics, see `io.driver_topics`.
        rig: calibration file, of the raw images. Of rectified ones the poses are taken from it, and the rest
            from their CameraInfo.

    Raises:
        UserError: on whatever the user can mend, before anything has started.
    """
    cameras = read_driver_topics(path)
    chosen = read_rig(rig).subset(cameras)
    require_two(chosen)
    for name, topics in cameras.items():
        if topics.encoding and topics.encoding not in ENCODINGS:
            raise DataError(
                f"{path}: camera {name} has encoding {topics.encoding!r}; known: {', '.join(ENCODINGS)}"
            )
    skeleton, extras = options.detector()
    prepare_environment()
    wanted = {name: _with_info(topics) for name, topics in cameras.items()}
    drivers = find_drivers({
        topic: f"{key} of camera {name}"
        for name, topics in wanted.items() for key, topic in topics.named.items()
    })  # fmt: skip
    notices: list[str] = []
    seen = tuple(_camera(chosen.camera(name), topics, drivers, notices) for name, topics in wanted.items())
    carriers: dict[str, dict[str, str]] = {}
    for name, topics in wanted.items():
        for key, topic in topics.named.items():
            carriers.setdefault(_carrier(name, key, topic, drivers), {})[name] = topic
    carriers.pop("camera_info", None)
    defaults: Parameters = {"detection": {"threads": max(1, (os.cpu_count() or 2) // 2)}}
    return options.complete(Plan(
        "drivers", _rig_of(chosen, seen), skeleton, with_defaults(options.all_parameters(), defaults),
        extras=extras, topics=carriers, live=True, notices=tuple(notices),
        encodings={name: topics.encoding for name, topics in cameras.items() if topics.encoding},
        depth_cameras=tuple(name for name, topics in cameras.items() if topics.depth),
    ))  # fmt: skip


def _rig_of(rig: Rig, cameras: tuple[Camera, ...]) -> Rig:
    by_name = {camera.name: camera for camera in cameras}
    return replace(rig, cameras=tuple(by_name[name] for name in rig.names))


def _is_rectified(topics: DriverTopics) -> bool:
    words = topics.image.removesuffix("/compressed").rsplit("/", 1)
    return RECTIFIED in words[-1] or words[-1].startswith("rect")


def _with_info(topics: DriverTopics) -> DriverTopics:
    """The topics with that of CameraInfo, which rectified images need: beside the image unless named."""
    if topics.camera_info or not _is_rectified(topics):
        return topics
    beside = topics.image.removesuffix("/compressed").rsplit("/", 1)[0]
    return replace(topics, camera_info=f"{beside}/camera_info")


def _carrier(camera: str, key: str, topic: str, drivers: Drivers) -> str:
    """Key of `graph.topics.TOPICS` of what a driver publishes."""
    kind = drivers.types[topic]
    if (key, kind) not in CARRIERS:
        known = " or ".join(message for name, message in CARRIERS if name == key)
        raise DataError(f"{topic} ({key} of camera {camera}) carries {kind}; expected {known}")
    return CARRIERS[key, kind]


def _camera(camera: Camera, topics: DriverTopics, drivers: Drivers, notices: list[str]) -> Camera:
    """The camera as its images are: raw as in the rig, or rectified by CameraInfo."""
    info = drivers.infos.get(topics.camera_info)
    if info is None:
        return camera
    if _is_rectified(topics):
        notices.append(f"camera {camera.name}: {topics.image} is rectified; lens and axes by CameraInfo")
        seen = rectified(camera, info)
    else:
        seen = camera
        _compare(camera, info, notices)
    _check_size(camera, info)
    return seen


def _check_size(camera: Camera, info: Any) -> None:
    size = int(info.width), int(info.height)
    if size != camera.image_size:
        sizes = [f"{width} x {height}" for width, height in (size, camera.image_size)]
        raise CalibrationError(
            f"camera {camera.name} publishes images of {sizes[0]}, but the rig is calibrated for {sizes[1]}"
        )


def _compare(camera: Camera, info: Any, notices: list[str]) -> None:
    """Tell where the driver's own calibration is another than the rig's, which counts."""
    try:
        own = camera_from_info(info, camera.name, camera.cam_from_world).intrinsics.matrix
    except DataError as error:
        notices.append(f"{error}; the rig's calibration is used")
        return
    ours = camera.intrinsics.matrix
    focal = np.array([[own[0, 0], ours[0, 0]], [own[1, 1], ours[1, 1]]])
    if np.abs(np.diff(np.log(np.abs(focal)), axis=1)).max() > SAME_FOCAL:
        notices.append(
            f"camera {camera.name}: its driver says focal length {own[0, 0]:.1f} px, the rig "
            f"{ours[0, 0]:.1f} px; the rig's is used"
        )


