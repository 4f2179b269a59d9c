"""Every topic of the graph: its name, the record it carries and the message that carries it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from panoptic_ros.errors import CalibrationError

# one topic per camera, depth sensor, device with sound, device on a body, or one
Scope = Literal["camera", "sensor", "device", "imu", "graph"]


@dataclass(frozen=True)
class Topic:
    """One topic.

    Args:
        key: how the code refers to it.
        name: with {owner} where there is one topic each.
        record: the record that it carries.
        message: the ROS type.
        latched: kept for subscribers who come late; has no end.
        by_stamp: one record for every one of a source, so stamps tell its place among other topics. The
            place of other records is that of the record from which they follow (see `graph.schedule`).
        variant_of: the topic that carries the same records as another message.
    """

    key: str
    name: str
    record: str
    message: str
    scope: Scope = "graph"
    latched: bool = False
    by_stamp: bool = False
    variant_of: str = ""

    def of(self, owner: str = "") -> str:
        """The topic of a camera, sensor or device, or the one of the graph."""
        return self.name.format(owner=ros_name(owner))


TOPICS: dict[str, Topic] = {
    topic.key: topic
    for topic in (
        Topic("image", "{owner}/image_raw", "ViewFrame", "sensor_msgs/msg/Image", "camera", by_stamp=True),
        Topic(
            "compressed_image",
            "{owner}/image_raw/compressed",
            "ViewFrame",
            "sensor_msgs/msg/CompressedImage",
            "camera",
            by_stamp=True,
            variant_of="image",
        ),
        Topic(
            "preview",
            "{owner}/preview/compressed",
            "Preview",
            "sensor_msgs/msg/CompressedImage",
            "camera",
            by_stamp=True,
        ),
        Topic(
            "depth",
            "{owner}/depth_registered/image_raw",
            "DepthFrame",
            "sensor_msgs/msg/Image",
            "camera",
            by_stamp=True,
        ),
        Topic(
            "compressed_depth",
            "{owner}/depth_registered/image_raw/compressedDepth",
            "DepthFrame",
            "sensor_msgs/msg/CompressedImage",
            "camera",
            by_stamp=True,
            variant_of="depth",
        ),
        Topic("camera_info", "{owner}/camera_info", "Camera", "sensor_msgs/msg/CameraInfo", "camera"),
        Topic(
            "sensor_depth",
            "{owner}/depth/image_raw",
            "DepthFrame",
            "sensor_msgs/msg/Image",
            "sensor",
            by_stamp=True,
        ),
        Topic(
            "compressed_sensor_depth",
            "{owner}/depth/image_raw/compressedDepth",
            "DepthFrame",
            "sensor_msgs/msg/CompressedImage",
            "sensor",
            by_stamp=True,
            variant_of="sensor_depth",
        ),
        Topic("sensor_info", "{owner}/depth/camera_info", "Camera", "sensor_msgs/msg/CameraInfo", "sensor"),
        # before detections of the same image, so that an instant has all of its tracks and colours (see
        # `graph.lanes`)
        Topic(
            "patch_tracks",
            "{owner}/patch_tracks",
            "PatchTracks",
            "panoptic_msgs/msg/PatchTracks",
            "camera",
            by_stamp=True,
        ),
        Topic(
            "appearance",
            "{owner}/appearance",
            "ViewAppearance",
            "sensor_msgs/msg/PointCloud2",
            "camera",
            by_stamp=True,
        ),
        Topic(
            "detections",
            "{owner}/detections",
            "ViewDetections",
            "panoptic_msgs/msg/ViewDetections",
            "camera",
            by_stamp=True,
        ),
        Topic(
            "audio", "{owner}/audio", "AudioBlock", "panoptic_msgs/msg/AudioBlock", "device", by_stamp=True
        ),
        Topic(
            "audio_common",
            "{owner}/audio_stamped",
            "AudioBlock",
            "audio_common_msgs/msg/AudioDataStamped",
            "device",
            by_stamp=True,
            variant_of="audio",
        ),
        Topic(
            "timecode", "{owner}/timecode", "TimecodeReading", "panoptic_msgs/msg/TimecodeReading", "device"
        ),
        Topic("clock_models", "clock_models", "ClockModel", "panoptic_msgs/msg/ClockModel", latched=True),
        Topic(
            "time_reference",
            "{owner}/time_reference",
            "ClockModel",
            "sensor_msgs/msg/TimeReference",
            "device",
        ),
        Topic("rig", "rig", "Rig", "panoptic_msgs/msg/Rig", latched=True),
        Topic(
            "skeleton_model",
            "skeleton_model",
            "SkeletonModel",
            "panoptic_msgs/msg/SkeletonModel",
            latched=True,
        ),
        Topic("subjects", "subjects", "SubjectSet", "panoptic_msgs/msg/SubjectSet", latched=True),
        Topic("detection_sets", "detection_sets", "DetectionSet", "panoptic_msgs/msg/DetectionSet"),
        Topic("associations", "associations", "AssociationSet", "panoptic_msgs/msg/AssociationSet"),
        Topic("proposals", "proposals", "ProposalSet", "panoptic_msgs/msg/ProposalSet"),
        Topic("poses", "poses", "PoseSet", "panoptic_msgs/msg/Skeletons"),
        Topic("skeletons_raw", "skeletons_raw", "TrackedPoseSet", "panoptic_msgs/msg/Skeletons"),
        Topic("tracks", "tracks", "TrackSet", "panoptic_msgs/msg/TrackSet"),
        Topic("imu", "{owner}/imu", "ImuSample", "sensor_msgs/msg/Imu", "imu", by_stamp=True),
        Topic("bodies", "bodies", "BodyStateSet", "panoptic_msgs/msg/Bodies"),
        Topic("patches", "patches", "PatchTrajectories", "panoptic_msgs/msg/PatchTrajectories"),
        Topic("skeletons", "skeletons", "RefinedPoseSet", "panoptic_msgs/msg/Skeletons"),
        Topic("markers", "skeletons/markers", "RefinedPoseSet", "visualization_msgs/msg/MarkerArray"),
    )
}


_NUMBERS = {key: number for number, key in enumerate(TOPICS)}


def variants(key: str) -> tuple[str, ...]:
    """The topics that carry the records of a topic as other messages."""
    return tuple(topic.key for topic in TOPICS.values() if topic.variant_of == key)


def number_of(key: str) -> int:
    """The number of a topic in the table, in which topics stand in the order in which records go down."""
    return _NUMBERS[key]


def owner_of(key: str, record: Any) -> str:
    """Whose topic a record belongs on: its camera or device, "" for topics of the graph."""
    scope = TOPICS[key].scope
    if scope == "graph":
        return ""
    return str(record.device if scope in ("device", "imu") else record.camera)


def given_inputs(owners: Mapping[str, Sequence[str]]) -> dict[str, list[str]]:
    """Parameters of a node that say who gives an optional topic or sends a variant: {"inputs.<key>": names}.

    Args:
        owners: by key of a topic; those without any are left out, as ROS knows no type for an empty list.
    """
    return {f"inputs.{key}": list(names) for key, names in owners.items() if names}


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
