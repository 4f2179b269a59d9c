"""Table of all topics of the graph: name, record and message type."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from panoptic_ros.errors import CalibrationError

# one topic per camera, depth sensor, audio device or IMU, or one for the whole graph
Scope = Literal["camera", "sensor", "device", "imu", "graph"]
Shown = Literal["", "always", "asked"]


@dataclass(frozen=True)
class Topic:
    """Topic of the graph.

    Args:
        key: Name of the topic in the code.
        name: ROS name, with {owner} if there is one topic per owner.
        record: Class name of its records.
        message: ROS message type.
        scope: Kind of its owners.
        latched: Whether it is kept for late subscribers. Such a topic has no end.
        by_stamp: Whether it has one record for every record of a source, so timestamps give its place among
            other topics. Other records get the place of the record from which they follow (see
            `graph.schedule`).
        variant_of: Topic that carries the same records as another message type.
        kept: When `panoptic run` writes it to its bag: "always", or if the parameter of this name
            ("stage.name") is true. "": never.
        recorded: Whether `panoptic record` writes it, in addition to inputs from outside.
        shown: Use by the viewer: "always", "asked" = while a page asks for it, "" = not used.
    """

    key: str
    name: str
    record: str
    message: str
    scope: Scope = "graph"
    latched: bool = False
    by_stamp: bool = False
    variant_of: str = ""
    kept: str = ""
    recorded: bool = False
    shown: Shown = ""

    def of(self, owner: str = "") -> str:
        """Return the topic name for a camera, sensor or device, or the only one of the graph."""
        return self.name.format(owner=ros_name(owner))


def _row(key: str, record: str, message: str, name: str = "", scope: Scope = "graph", **more: Any) -> Topic:
    """Return a topic whose ROS name is its key, unless `name` is given.

    Args:
        message: "package/Name", or a name in the message package of this project.
    """
    package, _, kind = message.rpartition("/")
    return Topic(key, name or key, record, f"{package or 'panoptic_msgs'}/msg/{kind}", scope, **more)


TOPICS: dict[str, Topic] = {
    topic.key: topic
    for topic in (
        _row("image", "ViewFrame", "sensor_msgs/Image", "{owner}/image_raw", "camera", by_stamp=True),
        _row(
            "compressed_image",
            "ViewFrame",
            "sensor_msgs/CompressedImage",
            "{owner}/image_raw/compressed",
            "camera",
            by_stamp=True,
            variant_of="image",
        ),
        _row(
            "preview",
            "Preview",
            "sensor_msgs/CompressedImage",
            "{owner}/preview/compressed",
            "camera",
            by_stamp=True,
            kept="always",
            shown="always",
        ),
        _row(
            "depth",
            "DepthFrame",
            "sensor_msgs/Image",
            "{owner}/depth_registered/image_raw",
            "camera",
            by_stamp=True,
        ),
        _row(
            "compressed_depth",
            "DepthFrame",
            "sensor_msgs/CompressedImage",
            "{owner}/depth_registered/image_raw/compressedDepth",
            "camera",
            by_stamp=True,
            variant_of="depth",
        ),
        _row("camera_info", "Camera", "sensor_msgs/CameraInfo", "{owner}/camera_info", "camera"),
        _row(
            "sensor_depth",
            "DepthFrame",
            "sensor_msgs/Image",
            "{owner}/depth/image_raw",
            "sensor",
            by_stamp=True,
        ),
        _row(
            "compressed_sensor_depth",
            "DepthFrame",
            "sensor_msgs/CompressedImage",
            "{owner}/depth/image_raw/compressedDepth",
            "sensor",
            by_stamp=True,
            variant_of="sensor_depth",
        ),
        _row("sensor_info", "Camera", "sensor_msgs/CameraInfo", "{owner}/depth/camera_info", "sensor"),
        # before the detections of the same image, so that an instant has all its tracks and colours (see
        # `graph.host`)
        _row(
            "patch_tracks",
            "PatchTracks",
            "PatchTracks",
            "{owner}/patch_tracks",
            "camera",
            by_stamp=True,
            kept="patches.active",
        ),
        _row(
            "appearance",
            "ViewAppearance",
            "sensor_msgs/PointCloud2",
            "{owner}/appearance",
            "camera",
            by_stamp=True,
        ),
        _row(
            "detections",
            "ViewDetections",
            "ViewDetections",
            "{owner}/detections",
            "camera",
            by_stamp=True,
            recorded=True,
            kept="always",
            shown="always",
        ),
        _row(
            "audio",
            "AudioBlock",
            "AudioBlock",
            "{owner}/audio",
            "device",
            by_stamp=True,
            recorded=True,
            kept="always",
        ),
        _row(
            "audio_common",
            "AudioBlock",
            "audio_common_msgs/AudioDataStamped",
            "{owner}/audio_stamped",
            "device",
            by_stamp=True,
            variant_of="audio",
        ),
        _row("timecode", "TimecodeReading", "TimecodeReading", "{owner}/timecode", "device", recorded=True),
        _row("clock_models", "ClockModel", "ClockModel", latched=True, recorded=True),
        _row("time_reference", "ClockModel", "sensor_msgs/TimeReference", "{owner}/time_reference", "device"),
        _row("rig", "Rig", "Rig", latched=True, recorded=True),
        _row("repaired_rig", "Rig", "Rig", latched=True),
        _row("skeleton_model", "SkeletonModel", "SkeletonModel", latched=True, recorded=True),
        _row("subjects", "SubjectSet", "SubjectSet", latched=True),
        _row("detection_sets", "DetectionSet", "DetectionSet"),
        _row("associations", "AssociationSet", "AssociationSet", shown="asked"),
        _row("proposals", "ProposalSet", "ProposalSet", shown="asked"),
        _row("poses", "PoseSet", "Skeletons"),
        _row("skeletons_raw", "TrackedPoseSet", "Skeletons", kept="patches.active", shown="asked"),
        _row("tracks", "TrackSet", "TrackSet"),
        _row("imu", "ImuSample", "sensor_msgs/Imu", "{owner}/imu", "imu", by_stamp=True, kept="always"),
        _row("bodies", "BodyStateSet", "Bodies", kept="always", shown="asked"),
        _row("patches", "PatchTrajectories", "PatchTrajectories", kept="patches.active", shown="asked"),
        _row("skeletons", "RefinedPoseSet", "Skeletons", recorded=True, kept="always", shown="always"),
        _row("skeletons_at", "RefinedPoseSet", "Skeletons", kept="continuous.active"),
        _row("markers", "RefinedPoseSet", "visualization_msgs/MarkerArray", "skeletons/markers"),
    )
}
ALWAYS_SHOWN = tuple(key for key, topic in TOPICS.items() if topic.shown == "always")
ASKED_FOR = tuple(key for key, topic in TOPICS.items() if topic.shown == "asked")
_NUMBERS = {key: number for number, key in enumerate(TOPICS)}


def variants(key: str) -> tuple[str, ...]:
    """Return the topics that carry the records of a topic as other message types."""
    return tuple(topic.key for topic in TOPICS.values() if topic.variant_of == key)


def number_of(key: str) -> int:
    """Return the number of a topic in the table, whose order is that of the data flow."""
    return _NUMBERS[key]


def owner_of(key: str, record: Any) -> str:
    """Return the owner of a record's topic: its camera or device, "" for topics of the graph."""
    scope = TOPICS[key].scope
    if scope == "graph":
        return ""
    return str(record.device if scope in ("device", "imu") else record.camera)


def given_inputs(owners: Mapping[str, Sequence[str]]) -> dict[str, list[str]]:
    """Return node parameters with the owners of optional topics and variants: {"inputs.<key>": names}.

    Args:
        owners: By key of a topic. Empty lists are left out, because ROS cannot type them.
    """
    return {f"inputs.{key}": list(names) for key, names in owners.items() if names}


_LONGEST = 100  # characters per name; the middleware allows 255 for a whole topic


def ros_name(name: str) -> str:
    """Return a name as ROS allows it in topics and nodes: "00_12-left" becomes camera_00_12_left."""
    plain = re.sub(r"[^A-Za-z0-9_]", "_", name)
    return f"camera_{plain}" if plain[:1].isdigit() else plain


def check_names(cameras: Iterable[str]) -> None:
    """Check that every camera can have its own topics.

    Raises:
        CalibrationError: names two cameras that would share topics, or one whose name is too long.
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
