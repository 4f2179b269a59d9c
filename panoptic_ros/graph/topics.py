"""Every topic of the graph: its name, the record it carries and the message that carries it."""
from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from panoptic_ros.errors import CalibrationError

Scope = Literal["camera", "device", "graph"]  # one topic per camera, per audio device, or one


@dataclass(frozen=True)
class Topic:
    """One topic.

    Args:
        key: how the code refers to it.
        name: with {camera} or {device} where there is one topic each.
        record: the record that it carries.
        message: the ROS type.
        latched: kept for subscribers who come late.
    """

    key: str
    name: str
    record: str
    message: str
    scope: Scope = "graph"
    latched: bool = False

    def of(self, owner: str = "") -> str:
        """The topic of a camera or device, or the one of the graph."""
        return self.name.format(camera=ros_name(owner), device=ros_name(owner))


TOPICS: dict[str, Topic] = {
    topic.key: topic
    for topic in (
        Topic("image", "{camera}/image_raw", "ViewFrame", "sensor_msgs/msg/Image", "camera"),
        Topic("compressed_image", "{camera}/image_raw/compressed", "ViewFrame",
              "sensor_msgs/msg/CompressedImage", "camera"),
        Topic("depth", "{camera}/depth_registered/image_raw", "ViewFrame", "sensor_msgs/msg/Image", "camera"),
        Topic("compressed_depth", "{camera}/depth_registered/image_raw/compressedDepth", "ViewFrame",
              "sensor_msgs/msg/CompressedImage", "camera"),
        Topic("camera_info", "{camera}/camera_info", "Camera", "sensor_msgs/msg/CameraInfo", "camera"),
        Topic("detections", "{camera}/detections", "ViewDetections",
              "panoptic_msgs/msg/ViewDetections", "camera"),
        Topic("audio", "{device}/audio", "AudioBlock", "panoptic_msgs/msg/AudioBlock", "device"),
        Topic("timecode", "{device}/timecode", "TimecodeReading",
              "panoptic_msgs/msg/TimecodeReading", "device"),
        Topic("clock_models", "clock_models", "ClockModel", "panoptic_msgs/msg/ClockModel", latched=True),
        Topic("time_reference", "{device}/time_reference", "ClockModel",
              "sensor_msgs/msg/TimeReference", "device"),
        Topic("rig", "rig", "Rig", "panoptic_msgs/msg/Rig", latched=True),
        Topic("skeleton_model", "skeleton_model", "SkeletonModel",
              "panoptic_msgs/msg/SkeletonModel", latched=True),
        Topic("detection_sets", "detection_sets", "DetectionSet", "panoptic_msgs/msg/DetectionSet"),
        Topic("proposals", "proposals", "ProposalSet", "panoptic_msgs/msg/ProposalSet"),
        Topic("poses", "poses", "PoseSet", "panoptic_msgs/msg/Skeletons"),
        Topic("skeletons_raw", "skeletons_raw", "TrackedPoseSet", "panoptic_msgs/msg/Skeletons"),
        Topic("skeletons", "skeletons", "RefinedPoseSet", "panoptic_msgs/msg/Skeletons"),
        Topic("markers", "skeletons/markers", "RefinedPoseSet", "visualization_msgs/msg/MarkerArray"),
    )
}  # fmt: skip

_LONGEST = 100  # characters; the middleware takes 255 for a whole topic


def ros_name(name: str) -> str:
    """A camera's or device's name as ROS allows it in topics and nodes: "00_12-left" is camera_00_12_left."""
    plain = re.sub(r"[^A-Za-z0-9_]", "_", name)
    return f"camera_{plain}" if plain[:1].isdigit() else plain


def check_names(cameras: Iterable[str]) -> None:
    """Whether every camera can have topics of its own.

    Raises:
        CalibrationError: naming two cameras that would share theirs, or one whose name is too long.
    """
    owners: dict[str, str] = {}
    for camera in cameras:
        if len(camera) > _LONGEST:
            raise CalibrationError(
                f"camera name {camera[:20] + '...'!r} has {len(camera)} characters; ROS topics have room for "
                f"{_LONGEST}"
            )
        other = owners.setdefault(ros_name(camera), camera)
        if other != camera:
            raise CalibrationError(
                f"cameras {other!r} and {camera!r} would both be {ros_name(camera)} in ROS, where names have "
                "letters, digits and _ only; rename one"
            )
