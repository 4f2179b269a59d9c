"""Every topic of the graph: its name, the record it carries and the message that carries it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from panoptic_ros.errors import CalibrationError

# one topic per camera, depth sensor, device with sound, device on a body, or one
Scope = Literal["camera", "sensor", "device", "imu", "graph"]
Shown = Literal["", "always", "asked"]


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
        kept: when `panoptic run` keeps it in its bag: "always", or where the parameter of this name
            ("stage.name") is true; "" = never.
        recorded: whether `panoptic record` keeps it beside what comes from outside.
        shown: by the viewer: "always", "asked" = while a page asks for it; "" = it is not.
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
        """The topic of a camera, sensor or device, or the one of the graph."""
        return self.name.format(owner=ros_name(owner))


def _row(key: str, record: str, message: str, name: str = "", scope: Scope = "graph", **more: Any) -> Topic:
    """A topic that is named as its key, if nothing else is said.

    Args:
        message: "package/Name", or a name of this project's package.
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
        # before detections of the same image, so that an instant has all of its tracks and colours (see
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
        _row("markers", "RefinedPoseSet", "visualization_msgs/MarkerArray", "skeletons/markers"),
    )
}
ALWAYS_SHOWN = tuple(key for key, topic in TOPICS.items() if topic.shown == "always")
ASKED_FOR = tuple(key for key, topic in TOPICS.items() if topic.shown == "asked")
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
