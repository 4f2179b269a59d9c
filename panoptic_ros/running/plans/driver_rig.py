"""The rig of running drivers: from a calibration, or from CameraInfo and TF alone."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from panoptic_ros.domain import Camera, DepthSensor, Rig
from panoptic_ros.errors import CalibrationError, DataError
from panoptic_ros.geometry import Rigid
from panoptic_ros.io.driver_topics import DriverFile, DriverTopics
from panoptic_ros.io.messages.camera_infos import (
    as_published,
    info_topic,
    plain_topic,
    rectified,
    whole_camera,
)
from panoptic_ros.nodes.sources.drivers import Drivers
from panoptic_ros.nodes.sources.transforms import find_transforms
from panoptic_ros.running.plans.fitting import check_size, fit_to_info

RECTIFIED = "_rect"  # in the last words of a topic's name, as image_proc and drivers call them
SAME_FOCAL = 0.01  # relative: what CameraInfo and the rig may differ by


def is_rectified(topics: DriverTopics) -> bool:
    """Whether the name of a topic says so."""
    word = plain_topic(topics.image).rsplit("/", 1)[-1]
    return RECTIFIED in word or word.startswith("rect")


def with_info(topics: DriverTopics, needed: bool) -> DriverTopics:
    """The topics with that of CameraInfo, which rectified images need: beside the image unless named.

    Args:
        needed: of raw ones too, as nothing else tells their lens.
    """
    if topics.camera_info or not (needed or is_rectified(topics)):
        return topics
    return replace(topics, camera_info=info_topic(topics.image or topics.depth))


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
    sensors = []
    for name in file.sensors:
        sensor = chosen.depth_sensor(name)
        info = drivers.infos.get(file.sensors[name].camera_info)
        own = sensor.camera if info is None else _fitted(sensor.camera, info, "depth maps", notices)
        sensors.append(replace(sensor, camera=own))
    return replace(chosen, cameras=cameras, depth_sensors=tuple(sensors))


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
    """Tell where the driver's own calibration is another than the rig's, which counts."""
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
            f"camera {camera.name}: its driver says focal length {own[0, 0]:.1f} px, the rig "
            f"{ours[0, 0]:.1f} px; the rig's is used"
        )
