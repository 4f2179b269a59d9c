"""The rig of running drivers: from a calibration, or from CameraInfo and TF alone."""
from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from panoptic_ros.domain import Camera, DepthSensor, Rig
from panoptic_ros.errors import CalibrationError, DataError
from panoptic_ros.geometry import Rigid
from panoptic_ros.io.driver_topics import DriverFile, DriverTopics
from panoptic_ros.io.messages.images import camera_from_info, rectified
from panoptic_ros.nodes.sources.drivers import Drivers
from panoptic_ros.nodes.sources.transforms import find_transforms

RECTIFIED = "_rect"  # in the last words of a topic's name, as image_proc and drivers call them
SAME_FOCAL = 0.01  # relative: what CameraInfo and the rig may differ by
PACKED = ("/compressedDepth", "/compressed")


def is_rectified(topics: DriverTopics) -> bool:
    """Whether the name of a topic says so."""
    words = _plain(topics.image).rsplit("/", 1)
    return RECTIFIED in words[-1] or words[-1].startswith("rect")


def with_info(topics: DriverTopics, needed: bool) -> DriverTopics:
    """The topics with that of CameraInfo, which rectified images need: beside the image unless named.

    Args:
        needed: of raw ones too, as nothing else tells their lens.
    """
    if topics.camera_info or not (needed or is_rectified(topics)):
        return topics
    beside = _plain(topics.image or topics.depth).rsplit("/", 1)[0]
    return replace(topics, camera_info=f"{beside}/camera_info")


def _plain(topic: str) -> str:
    """The topic without the name of a transport."""
    for ending in PACKED:
        topic = topic.removesuffix(ending)
    return topic


def rig_by_calibration(rig: Rig, file: DriverFile, drivers: Drivers, notices: list[str]) -> Rig:
    """The rig's cameras and depth sensors that have topics, as their images are: raw, or rectified by
    CameraInfo.

    Args:
        notices: lines about what differs are added here.

    Raises:
        CalibrationError: naming what the rig has not, or calibrates for another size.
    """
    chosen = rig.subset(file.cameras)
    cameras = tuple(_seen(camera, file.cameras[camera.name], drivers, notices) for camera in chosen.cameras)
    sensors = tuple(chosen.depth_sensor(name) for name in file.sensors)
    for sensor in sensors:
        info = drivers.infos.get(file.sensors[sensor.name].camera_info)
        if info is not None:
            _check_size(sensor.camera, info, "depth maps")
    return replace(chosen, cameras=cameras, depth_sensors=sensors)


def rig_by_transforms(file: DriverFile, drivers: Drivers, fixed: str, notices: list[str]) -> Rig:
    """The rig that CameraInfo (lenses, frames) and TF (poses of optical frames) tell of.

    Args:
        fixed: the frame that is the world; "" = the top of the tree.

    Raises:
        CalibrationError, EnvironmentProblem: naming what is missing, with the remedy.
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
        raw = _from_info(infos[name], name, pose)
        cameras[name] = _rectified_in_place(raw, infos[name]) if is_rectified(topics) else raw
    return Rig(
        tuple(cameras[name] for name in file.cameras), world,
        depth_sensors=tuple(DepthSensor(cameras[name]) for name in file.sensors),
    )  # fmt: skip


def _from_info(info: Any, name: str, cam_from_world: Rigid) -> Camera:
    try:
        return camera_from_info(info, name, cam_from_world)
    except DataError as error:
        raise CalibrationError(f"{error}; calibrate it, or give --rig") from None


def _rectified_in_place(camera: Camera, info: Any) -> Camera:
    """The rectified camera; the second of a stereo pair stands beside the frame that both name (REP 104)."""
    seen = rectified(camera, info)
    projection = np.array(info.p, float).reshape(3, 4)
    aside = np.linalg.solve(projection[:, :3], projection[:, 3])
    return replace(seen, cam_from_world=Rigid(np.eye(3), aside).compose(seen.cam_from_world))


def _seen(camera: Camera, topics: DriverTopics, drivers: Drivers, notices: list[str]) -> Camera:
    """The camera as its images are: raw as in the rig, or rectified by CameraInfo."""
    info = drivers.infos.get(topics.camera_info)
    if info is None:
        return camera
    if is_rectified(topics):
        notices.append(f"camera {camera.name}: {topics.image} is rectified; lens and axes by CameraInfo")
        seen = rectified(camera, info)
    else:
        seen = camera
        _compare(camera, info, notices)
    _check_size(camera, info, "images")
    return seen


def _check_size(camera: Camera, info: Any, what: str) -> None:
    size = int(info.width), int(info.height)
    if size != camera.image_size:
        sizes = [f"{width} x {height}" for width, height in (size, camera.image_size)]
        raise CalibrationError(
            f"camera {camera.name} publishes {what} of {sizes[0]}, but the rig is calibrated for {sizes[1]}"
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
