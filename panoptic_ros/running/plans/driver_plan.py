"""Makes plans of live runs on topics of running drivers.

The rig comes from a calibration file, or from CameraInfo and TF alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.domain import Camera, DepthSensor, Rig
from panoptic_ros.errors import CalibrationError, DataError, UsageError
from panoptic_ros.geometry import Rigid
from panoptic_ros.io.driver_topics import DriverFile, DriverTopics, read_driver_topics
from panoptic_ros.io.messages.camera_infos import (
    as_published,
    info_topic,
    plain_topic,
    rectified,
    whole_camera,
)
from panoptic_ros.io.messages.encodings import encoding_of, is_mosaic
from panoptic_ros.io.messages.images import is_video, video_told
from panoptic_ros.io.rigs import read_rig
from panoptic_ros.nodes.sources.drivers import DriverSearchResult, find_drivers
from panoptic_ros.nodes.sources.transforms import find_transforms
from panoptic_ros.running.plans.fitting import check_size, fit_to_info
from panoptic_ros.running.plans.options import NO_OPTIONS, RunOptions
from panoptic_ros.running.plans.parameters import live_parameters, with_defaults
from panoptic_ros.running.plans.plan import Plan, require_cameras
from panoptic_ros.running.processes.children import prepare_environment

RECTIFIED = "_rect"  # marks rectified images in the last word of a topic name, as image_proc and drivers do
SAME_FOCAL = 0.01  # relative tolerance between the focal lengths of CameraInfo and the rig


def is_rectified(topics: DriverTopics) -> bool:
    """Return whether the topic name marks rectified images."""
    word = plain_topic(topics.image).rsplit("/", 1)[-1]
    return RECTIFIED in word or word.startswith("rect")


def with_info(topics: DriverTopics, needed: bool) -> DriverTopics:
    """Return the topics, completed by the CameraInfo topic beside the image where it is needed.

    Rectified images always need CameraInfo. A CameraInfo topic that the user names is kept.

    Args:
        needed: whether raw images need it, too, as no other source gives their lens parameters.
    """
    if topics.camera_info or not (needed or is_rectified(topics)):
        return topics
    return replace(topics, camera_info=info_topic(topics.image or topics.depth))


def rig_by_calibration(rig: Rig, file: DriverFile, drivers: DriverSearchResult, notices: list[str]) -> Rig:
    """Return the rig's cameras and depth sensors that have topics, adapted to their published images.

    The images are raw, or rectified by CameraInfo.

    Args:
        notices: receives lines about differences.

    Raises:
        CalibrationError: if the rig lacks a camera or sensor, or is calibrated for another image size.
    """
    chosen = rig.subset(file.cameras)
    cameras = tuple(_seen(camera, file.cameras[camera.name], drivers, notices) for camera in chosen.cameras)
    sensors = []
    for name in file.sensors:
        sensor = chosen.depth_sensor(name)
        info = drivers.infos.get(file.sensors[name].camera_info)
        own = sensor.camera if info is None else _fitted(sensor.camera, info, "depth maps", notices)
        sensors.append(replace(sensor, camera=own))
    return replace(chosen, cameras=cameras, depth_sensors=tuple(sensors))


def rig_by_transforms(file: DriverFile, drivers: DriverSearchResult, fixed: str, notices: list[str]) -> Rig:
    """Return the rig from CameraInfo (lenses, frames) and TF (poses of the optical frames).

    Args:
        fixed: TF frame that becomes the world frame; "" = the root of the TF tree.

    Raises:
        CalibrationError, EnvironmentProblem: if something is missing; the message states the remedy.
    """
    infos = {name: drivers.infos[topics.camera_info] for name, topics in file.everything.items()}
    frames = {name: str(info.header.frame_id).lstrip("/") for name, info in infos.items()}
    for name, frame in frames.items():
        if not frame:
            topic = file.everything[name].camera_info
            raise CalibrationError(
                f"camera_info of {name} ({topic}) names no frame: its pose is not known; give --rig"
            )
    world, poses = find_transforms(sorted(set(frames.values())), fixed)
    named = ", ".join(f"{name} at {frame}" for name, frame in frames.items())
    notices.append(f"poses from TF, in {world}: {named}")
    cameras = {}
    for name, topics in file.everything.items():
        pose = poses[frames[name]].inverse()
        whole = _from_info(infos[name], name, pose, notices)
        seen = _rectified_in_place(whole, infos[name]) if is_rectified(topics) else whole
        cameras[name] = as_published(seen, infos[name])
    return Rig(
        tuple(cameras[name] for name in file.cameras),
        world,
        depth_sensors=tuple(DepthSensor(cameras[name]) for name in file.sensors),
    )


def _from_info(info: Any, name: str, cam_from_world: Rigid, notices: list[str]) -> Camera:
    try:
        camera, assumed = whole_camera(info, name, cam_from_world)
    except DataError as error:
        raise CalibrationError(f"{error}; calibrate it, or give --rig") from None
    if assumed:
        notices.append(assumed)
    return camera


def _rectified_in_place(camera: Camera, info: Any) -> Camera:
    """Return the rectified camera at its true position.

    Both CameraInfos of a stereo pair name the frame of the first camera. The second camera is beside that
    frame (REP 104).
    """
    seen = rectified(camera, info)
    projection = np.array(info.p, float).reshape(3, 4)
    aside = np.linalg.solve(projection[:, :3], projection[:, 3])
    return replace(seen, cam_from_world=Rigid(np.eye(3), aside).compose(seen.cam_from_world))


def _seen(camera: Camera, topics: DriverTopics, drivers: DriverSearchResult, notices: list[str]) -> Camera:
    """Return the camera of the published images: raw as in the rig, or rectified by CameraInfo."""
    info = drivers.infos.get(topics.camera_info)
    if info is None:
        return camera
    if not is_rectified(topics):
        seen = _fitted(camera, info, "images", notices)
        _compare(seen, info, notices)
        return seen
    notices.append(f"camera {camera.name}: {topics.image} is rectified; lens and axes by CameraInfo")
    check_size(camera, info, "images")
    return as_published(rectified(camera, info), info)


def _fitted(camera: Camera, info: Any, what: str, notices: list[str]) -> Camera:
    fitted, told = fit_to_info(camera, info, what)
    if told:
        notices.append(f"camera {camera.name}: {told}")
    return fitted


def _compare(camera: Camera, info: Any, notices: list[str]) -> None:
    """Add a line where the driver's calibration differs from the rig's. The rig's calibration is used."""
    try:
        whole, assumed = whole_camera(info, camera.name, camera.cam_from_world)
    except DataError as error:
        notices.append(f"{error}; the rig's calibration is used")
        return
    if assumed:
        notices.append(f"{assumed}; the rig's calibration is used")
    own, ours = as_published(whole, info).intrinsics.matrix, camera.intrinsics.matrix
    focal = np.array([[own[0, 0], ours[0, 0]], [own[1, 1], ours[1, 1]]])
    if np.abs(np.diff(np.log(np.abs(focal)), axis=1)).max() > SAME_FOCAL:
        notices.append(
            f"camera {camera.name}: its driver states a focal length of {own[0, 0]:.1f} px, the rig "
            f"{ours[0, 0]:.1f} px; the rig's is used"
        )


CARRIERS = {
    ("image", "sensor_msgs/msg/Image"): "image",
    ("image", "sensor_msgs/msg/CompressedImage"): "compressed_image",
    ("depth", "sensor_msgs/msg/Image"): "depth",
    ("depth", "sensor_msgs/msg/CompressedImage"): "compressed_depth",
    ("camera_info", "sensor_msgs/msg/CameraInfo"): "camera_info",
}
SENSOR_CARRIERS = {
    ("depth", "sensor_msgs/msg/Image"): "sensor_depth",
    ("depth", "sensor_msgs/msg/CompressedImage"): "compressed_sensor_depth",
    ("camera_info", "sensor_msgs/msg/CameraInfo"): "sensor_info",
}
NOT_TAKEN = ("camera_info", "sensor_info")  # messages that are read once, at the start


def plan_drivers(
    path: Path, options: RunOptions = NO_OPTIONS, *, rig: Path | None = None, fixed_frame: str = ""
) -> Plan:
    """Return the plan of a live run on the topics of running drivers.

    Args:
        path: file of the topics, see `io.driver_topics`.
        rig: calibration file for the raw images. For rectified images, it provides the poses, and CameraInfo
            the rest. None = lenses from CameraInfo, poses from TF.
        fixed_frame: TF frame that replaces the one in the file of the topics.

    Raises:
        UserError: on any fault that the user can fix, before anything has started.
    """
    file = read_driver_topics(path)
    calibrated = None if rig is None else read_rig(rig, cameras=tuple(file.cameras))
    if calibrated is not None:
        if file.fixed_frame or fixed_frame:
            raise UsageError("--fixed-frame names a frame of TF, which is not used with --rig")
        require_cameras(calibrated.subset(file.cameras), bool(options.subjects))
    elif len(file.cameras) < (1 if options.subjects else 2):
        raise CalibrationError(
            f"{path} names {len(file.cameras)} camera, which is not enough for 3D; with --subject FILE "
            "one is enough for a body"
        )
    _check_encodings(path, file)
    skeleton, extras = options.detector()
    prepare_environment()
    file = replace(
        file,
        cameras={name: with_info(topics, calibrated is None) for name, topics in file.cameras.items()},
        sensors={name: with_info(topics, True) for name, topics in file.sensors.items()},
    )
    why = {"camera_info": ", needed without --rig"} if calibrated is None else {}
    drivers = find_drivers(
        {
            topic: f"{key} of {'depth sensor' if name in file.sensors else 'camera'} {name}{why.get(key, '')}"
            for name, topics in file.everything.items()
            for key, topic in topics.named.items()
        }
    )
    notices: list[str] = []
    carriers = _carriers(file, drivers)
    notices += [
        f"encoding {own} of camera {name} has no meaning, as its images are compressed"
        for name in carriers.get("compressed_image", ())
        if (own := file.cameras[name].encoding) and not is_mosaic(own)
    ]
    found = (
        rig_by_transforms(file, drivers, fixed_frame or file.fixed_frame, notices)
        if calibrated is None
        else rig_by_calibration(calibrated, file, drivers, notices)
    )
    return options.complete(
        Plan(
            "drivers",
            found,
            skeleton,
            with_defaults(options.all_parameters(), live_parameters(cameras=len(found))),
            extras=extras,
            topics=carriers,
            live=True,
            notices=tuple(notices),
            encodings={name: topics.encoding for name, topics in file.cameras.items() if topics.encoding},
            depth_cameras=tuple(name for name, topics in file.cameras.items() if topics.depth),
        )
    )


def _check_encodings(path: Path, file: DriverFile) -> None:
    for name, topics in file.cameras.items():
        if topics.encoding:
            encoding_of(topics.encoding, f"{path}: camera {name}")


def _carriers(file: DriverFile, drivers: DriverSearchResult) -> dict[str, dict[str, str]]:
    """Return the topic names by key of `graph.topics.TOPICS` and owner."""
    found: dict[str, dict[str, str]] = {}
    for owners, known in ((file.cameras, CARRIERS), (file.sensors, SENSOR_CARRIERS)):
        for name, key, topic in _named(owners):
            kind = drivers.types[topic]
            if is_video(kind):
                raise DataError(f"{key} of camera {name}: {video_told(topic, kind)}")
            if (key, kind) not in known:
                expected = " or ".join(message for word, message in known if word == key)
                raise DataError(f"{topic} ({key} of camera {name}) carries {kind}; expected {expected}")
            found.setdefault(known[key, kind], {})[name] = topic
    return {key: topics for key, topics in found.items() if key not in NOT_TAKEN}


def _named(owners: Mapping[str, DriverTopics]) -> list[tuple[str, str, str]]:
    """Return (owner, key, topic) of all topics."""
    return [(name, key, topic) for name, topics in owners.items() for key, topic in topics.named.items()]
