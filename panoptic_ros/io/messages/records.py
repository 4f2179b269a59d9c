"""Convert every record of the graph to its message and back.

Own message types have a `Table`; message types of other packages have a pair of functions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from fractions import Fraction
from itertools import accumulate
from typing import Any, get_args

import numpy as np

from panoptic_ros.domain import (
    AssociationSet,
    AudioBlock,
    BodyStateSet,
    Camera,
    ClockModel,
    DepthSensor,
    DetectionSet,
    Evidence,
    FrameRate,
    Groups,
    Occluders,
    PartMotions,
    PatchTracks,
    PatchTrajectories,
    PoseSet,
    Prediction,
    ProposalSet,
    RefinedPoseSet,
    Rig,
    ScoreMaps,
    SkeletonModel,
    SubjectSet,
    Timecode,
    TimecodeReading,
    TimeShift,
    TrackedPoseSet,
    TrackSet,
    ViewDetections,
    ViewSources,
    VisibilityLimit,
)
from panoptic_ros.errors import CalibrationError, ClockError, ContractError, DataError
from panoptic_ros.geometry import Intrinsics, Lens, Rigid
from panoptic_ros.io.messages import images, sensors
from panoptic_ros.io.messages.family import MessageFamily
from panoptic_ros.io.messages.table import COUNT, TIME, Field, PersonRows, Table, Values

Array = np.ndarray
i32, i64, f32, f64 = np.int32, np.int64, np.float32, np.float64


def _arrays(kind: Any, prefix: str = "", part: str = "", own: Any = None, **shapes: str) -> tuple[Field, ...]:
    """Return fields of one type.

    Args:
        prefix: Prefix of the field names in the message.
        part: Attribute of the record that holds the values; "" = the record itself.
        own: Array type in the record, see `Field`.
        shapes: Shape by attribute.
    """
    return tuple(
        Field(prefix + name, kind, shape, f"{part}.{name}" if part else "", own)
        for name, shape in shapes.items()
    )


_INDEX, _HASH, _JOINTS = (
    Field("index", int),
    Field("skeleton_hash", str),
    Field("joint_count", COUNT, "J"),
)

_MAPS = Table(
    "ScoreMaps",
    ScoreMaps,
    None,
    (
        Field("grid_width grid_height", int, of="grid_size"),
        *_arrays(f64, grid_from_image="2 3"),
        *_arrays(i32, joints="N", persons="N", corners="N 2", sizes="N 2"),
        *_arrays(np.uint8, data="B"),
    ),
)
_NO_PATCHES, _NO_PAIRS = np.zeros(0, i32), np.zeros((0, 2), i32)
_NO_MAPS = ScoreMaps((1, 1), np.eye(2, 3), _NO_PATCHES, _NO_PATCHES, _NO_PAIRS, _NO_PAIRS, _NO_PATCHES)


_VIEW = Table(
    "ViewDetections",
    ViewDetections,
    ("stamp_ns", "camera"),
    (
        Field("frame_number", int),
        Field("image_width image_height", int, of="image_size"),
        _HASH,
        Field("person_count", COUNT, "P"),
        _JOINTS,
        *_arrays(f64, points="P J 2", scores="P J", person_scores="P"),
        Field("has_maps", bool, of=lambda view: view.maps is not None),
        Field("maps", _MAPS, of=lambda view: view.maps or _NO_MAPS, optional="has_maps"),
        Field("limit_rows", COUNT, "H"),
        Field("limit_columns", COUNT, "W"),
        Field("limits", np.uint16, "H W", "limit.cells"),
        Field("carried", f64, "P", optional=True),
    ),
    {"limit": (VisibilityLimit, True)},
)
_SET = Table("DetectionSet", DetectionSet, ("stamp_ns", ""), (_INDEX, _HASH, Field("views", _VIEW, "V")))


def _below(field: str, values: Array, count: int, least: int = 0) -> None:
    """Check that all indices are in least..count-1.

    Raises:
        DataError: otherwise.
    """
    if values.size and not least <= values.min() <= values.max() < count:
        raise DataError(f"AssociationSet.{field} names {values.min()} to {values.max()}, of {count}")


def _check_association(values: Values) -> None:
    """Compute the derived values, and check every index: the kernels do not check them.

    Raises:
        DataError: if an index or a value is out of range.
    """
    counts, rows, slots = values.pop("view_people"), values["evidence.rows"], values["evidence.slots"]
    if (counts < 0).any() or counts.sum() != len(rows):
        raise DataError(f"AssociationSet.view_people names {counts.sum()} 2D people of {len(rows)}")
    starts = np.concatenate([[0], np.cumsum(counts)])
    values["evidence.starts"], values["evidence.view"] = starts, np.repeat(np.arange(len(counts)), counts)
    scores, magnification = values["evidence.scores"], values["evidence.magnification"]
    if scores.size and not (0.0 <= scores.min() <= scores.max() <= 1.0 and magnification.min() > 0.0):
        raise DataError("AssociationSet has scores outside of 0..1, or a magnification that is not positive")
    views = values["detections"].views
    _below("cameras", values["evidence.cameras"], 2**31)
    _below("slots", slots, len(views))
    _below("members", values["groups.member"], len(rows), -1)
    _below("continues", values["who"], len(values["prediction.ages"]), -1)
    for view, slot in enumerate(slots):
        _below("rows", rows[starts[view] : starts[view + 1]], len(views[slot].points))


_ASSOCIATION = Table(
    "AssociationSet",
    AssociationSet,
    ("stamp_ns", ""),
    (
        Field("detections", _SET),
        _JOINTS,
        *_arrays(i32, part="evidence", own=i64, cameras="V", slots="V", rows="D"),
        Field("view_people", i32, "V", lambda item: np.diff(item.evidence.starts), i64),
        *_arrays(f64, part="evidence", own=f64, delays="V", plane="D J 2", magnification="D J", scores="D J"),
        Field("continues", i32, "P", "who", i64),
        Field("members", i32, "P V", "groups.member", i64),
        Field("mirrored", np.uint8, "P V", "groups.mirrored", np.bool_),
        Field("places", f64, "P J 3", own=f64),
        *_arrays(f64, part="prediction", own=f64, ages="K J", variances="K J 3", lengths="K B"),
        Field("predicted_positions", f64, "K J 3", "prediction.positions", f64),
        Field("predicted_velocities", f64, "K J 3", "prediction.velocities", f64),
        Field("firm", np.uint8, "K J", "prediction.firm", np.bool_),
    ),
    {"evidence": (Evidence, False), "groups": (Groups, False), "prediction": (Prediction, False)},
    _check_association,
)
_SHIFT = {  # message field: (attribute of `TimeShift`, shape)
    "delays": ("delays", "P J 3 3"),
    "assumed_velocities": ("assumed", "P J 3"),
    "velocities": ("velocities", "P J 3"),
    "velocity_information": ("information", "P J 3 3"),
}


def _skeletons(record: type[PoseSet]) -> Table:
    is_tracked = issubclass(record, TrackedPoseSet)
    return Table(
        "Skeletons",
        record,
        ("stamp_ns", ""),
        (
            _INDEX,
            _HASH,
            _JOINTS,
            Field("newest_stamp", TIME, of="newest_ns"),
            Field("view_cameras", str, "V", "sources.cameras"),
            Field("view_frames", np.uint64, "V", "sources.frames"),
            PersonRows(
                "skeletons",
                "Skeleton",
                (
                    Field(
                        "id", i64, "P", "ids" if is_tracked else lambda item: np.full(len(item.scores), -1)
                    ),
                    Field("score", f64, "P", "person_scores"),
                    *_arrays(f64, positions="P J 3", covariances="P J 3 3", scores="P J"),
                    *_arrays(i32, views="P J"),
                    *_arrays(np.uint8, states="P J"),
                    Field("view_persons", i32, "P V", "sources.persons"),
                    Field("corrections", f64, "P J 3", optional=True),
                    Field("side_votes", f64, "P G", optional=True),
                    *(
                        Field(name, f64, shape, f"time_shift.{attribute}", optional="delays")
                        for name, (attribute, shape) in _SHIFT.items()
                    ),
                ),
            ),
        ),
        {"sources": (ViewSources, True), "time_shift": (TimeShift, True)},
    )


def _check_bodies(values: Values) -> None:
    if not len(values["ids"]):
        values["freedoms"] = np.zeros((0, 3 + 3 * len(values["segment_names"])))


def _pairs(values: Iterable[Any]) -> tuple[tuple[int, int], ...]:
    return tuple((int(a), int(b)) for a, b in values)


def _complete_skeleton(values: Values) -> None:
    del values["hash"]  # follows from the other fields
    joints, counts, sources = (
        values.pop(f"derived_{name}").tolist() for name in ("joints", "counts", "sources")
    )
    ends = accumulate(counts)
    values["derived"] = tuple(
        (joint, tuple(sources[end - n : end])) for joint, n, end in zip(joints, counts, ends)
    )
    values["bones"], values["left_right"] = _pairs(values["bones"]), _pairs(values["left_right"])
    values["bias_floors"] = tuple(values["bias_floors"].tolist())


def _check_lens(values: Values) -> None:
    if values["intrinsics.lens"] not in get_args(Lens):
        raise DataError(f"Camera.lens is {values['intrinsics.lens']!r}, expected 'brown' or 'fisheye'")


_CAMERA = Table(
    "Camera",
    Camera,
    None,
    (
        *(Field(name, str) for name in ("name", "type", "panel", "clock")),
        Field("width height", int, of="image_size"),
        *_arrays(f64, part="intrinsics", matrix="3 3", distortion="T"),
        Field("lens", str, of="intrinsics.lens"),
        *_arrays(f64, part="cam_from_world", rotation="3 3", translation="3"),
        Field("line_delay_us", float),
        Field("covariance", f64, "N N", optional=True),
    ),
    {"intrinsics": (Intrinsics, False), "cam_from_world": (Rigid, False)},
    _check_lens,
)
_SENSOR = Table(
    "DepthSensor",
    DepthSensor,
    None,
    (Field("camera", _CAMERA), Field("colour_camera", str), Field("unit_m", float)),
)


def _one_channel_unless_said(values: Values) -> None:
    channels = values.pop("channels") or 1  # 0: a publisher of one channel need not set it
    samples = values["samples"]
    if len(samples) % channels:
        raise DataError(f"AudioBlock.samples has {len(samples)} values for {channels} channels")
    values["samples"] = samples.reshape(len(samples) // channels, channels)


_LABEL = ("hours", "minutes", "seconds", "frames")


def _complete_timecode(values: Values) -> None:
    if not values["rate_denominator"]:
        raise DataError("TimecodeReading.rate_denominator is 0")
    exact = Fraction(values.pop("rate_numerator"), values.pop("rate_denominator"))
    values["timecode.rate"] = FrameRate(round(exact), exact, values.pop("drop_frame"))


_TABLES = (
    _VIEW,
    _SET,
    _ASSOCIATION,
    Table(
        "TrackSet",
        TrackSet,
        ("stamp_ns", ""),
        (
            _INDEX,
            _HASH,
            _JOINTS,
            *_arrays(i64, own=i64, ids="T"),
            *_arrays(f64, own=f64, states="T J 6", variances="T J 3", ages="T J", unagreed="T J"),
            *_arrays(f64, own=f64, unseen="T", lengths="T B"),
        ),
    ),
    Table(
        "SubjectSet",
        SubjectSet,
        ("stamp_ns", ""),
        (
            *_arrays(i64, ids="S"),
            Field("places", f64, "S 3", optional=True),
            Field("times", i64, "S", optional=True),
            Field("tracks", i64, "S", optional=True),
        ),
    ),
    Table(
        "ProposalSet",
        ProposalSet,
        ("stamp_ns", ""),
        (
            Field("association", _ASSOCIATION),
            *_arrays(i32, node_joints="N", node_views="N", part_bones="M", parts="M 2"),
            *_arrays(f64, nodes="N 3", node_scores="N", part_scores="M"),
        ),
    ),
    Table(
        "PatchTracks",
        PatchTracks,
        ("stamp_ns", "camera"),
        (
            Field("frame_number", int),
            Field("before", TIME, of="before_ns"),
            Field("before_number", int),
            _HASH,
            *_arrays(i32, persons="N", parts="N"),
            *_arrays(f32, begins="N 2", ends="N 2", information="N 3"),
        ),
    ),
    Table(
        "PatchTrajectories",
        PatchTrajectories,
        ("stamp_ns", ""),
        (
            _INDEX,
            Field("before", TIME, of="before_ns"),
            _HASH,
            Field("cameras", str, "C"),
            *_arrays(i64, ids="N", people="N", free="F 2"),
            *_arrays(i32, ages="N", parts="N"),
            *_arrays(f32, positions="N 3", normals="N 3", sigmas="N", visible="N C"),
            *_arrays(i64, "motion_", "motions", people="M"),
            *_arrays(i32, "motion_", "motions", parts="M", tracks="M"),
            *_arrays(f64, "motion_", "motions", centres="M 3", rotations="M 3", translations="M 3"),
            *_arrays(f64, "motion_", "motions", covariances="M 6 6", residuals="M"),
        ),
        {"motions": (PartMotions, False)},
    ),
    *map(_skeletons, (PoseSet, TrackedPoseSet, RefinedPoseSet)),
    Table(
        "Bodies",
        BodyStateSet,
        ("stamp_ns", ""),
        (
            Field("newest_stamp", TIME, of="newest_ns"),
            _INDEX,
            _HASH,
            _JOINTS,
            Field("segment_names", str, "S"),
            *_arrays(i32, parents="S"),
            PersonRows(
                "bodies",
                "Body",
                (
                    Field("id", i64, "B", "ids"),
                    Field("source", np.uint8, "B", "sources"),
                    *_arrays(i32, views="B", devices="B"),
                    *_arrays(f64, offsets="B S 3", freedoms="B D", positions="B S 3", orientations="B S 4"),
                    *_arrays(f64, velocities="B S 6", covariances="B S 6 6"),
                    *_arrays(f64, keypoints="B J 3", keypoint_covariances="B J 3 3"),
                ),
            ),
        ),
        complete=_check_bodies,
    ),
    Table(
        "SkeletonModel",
        SkeletonModel,
        None,
        (
            Field("name", str),
            Field("hash", str, of=lambda model: model.hash),
            Field("joint_names", str, "J"),
            Field("root", int),
            Field("head", int),
            *_arrays(i32, bones="B 2", left_right="L 2"),
            Field("derived_joints", i32, "D", lambda model: [joint for joint, _ in model.derived]),
            Field("derived_counts", i32, "D", lambda model: [len(found) for _, found in model.derived]),
            Field(
                "derived_sources", i32, "S", lambda model: [s for _, found in model.derived for s in found]
            ),
            *_arrays(f64, bias_floors="F"),
        ),
        complete=_complete_skeleton,
    ),
    Table(
        "Rig",
        Rig,
        ("", "frame_id"),
        (
            Field("cameras", _CAMERA, "C"),
            Field("depth_sensors", _SENSOR, "K"),
            Field("occluder_triangles", np.uint32, "M 3", "occluders.triangles"),
            Field("occluder_vertices", f64, "N 3", "occluders.vertices"),
        ),
        {"occluders": (Occluders, True)},
    ),
    Table(
        "AudioBlock",
        AudioBlock,
        ("stamp_ns", "device"),
        (
            Field("first_sample", int),
            Field("sample_rate", int),
            *_arrays(f32, samples="N"),
            Field("channels", int, of=lambda block: block.samples.shape[1]),
            Field("clocks", str, "C"),
        ),
        complete=_one_channel_unless_said,
    ),
    Table(
        "TimecodeReading",
        TimecodeReading,
        ("stamp_ns", "device"),
        (
            *(Field(name, int, of=f"timecode.{name}") for name in _LABEL),
            Field("rate_numerator", int, of=lambda reading: reading.timecode.rate.exact.numerator),
            Field("rate_denominator", int, of=lambda reading: reading.timecode.rate.exact.denominator),
            Field("drop_frame", bool, of=lambda reading: reading.timecode.rate.drop_frame),
            Field("start_sample", float),
            Field("std_samples", float),
            Field("reverse", bool),
            Field("user_bits", int),
            Field("clock", str),
            Field("sample_rate", int),
        ),
        {"timecode": (Timecode, False)},
        _complete_timecode,
    ),
    Table(
        "ClockModel",
        ClockModel,
        ("reference_ns", "device"),
        (
            *(Field(name, int) for name in ("offset_ns", "from_ns", "until_ns", "segment")),
            *(Field(name, float) for name in ("residual_ns", "drift", "wander")),
            *_arrays(f64, covariance="2 2"),
        ),
    ),
)
_OF_RECORD = {table.record.__name__: table for table in _TABLES}
_WRITERS: dict[str, Callable[[Any, MessageFamily, str], Any]] = {
    "Preview": images.write_preview,
    "ViewAppearance": sensors.write_appearance,
    "ImuSample": sensors.write_imu,
    **{name: table.write for name, table in _OF_RECORD.items()},
}
_READERS: dict[str, Callable[[Any], Any]] = {
    "Preview": images.read_preview,
    "ViewAppearance": sensors.read_appearance,
    "ImuSample": lambda message: sensors.read_imu(message, str(message.header.frame_id)),
    **{name: table.read for name, table in _OF_RECORD.items()},
}
_INSIDE = {  # record class that a record's message contains and that another node publishes
    name: field.kind.record.__name__
    for name, table in _OF_RECORD.items()
    for field in table.fields
    if isinstance(field, Field) and isinstance(field.kind, Table) and field.kind.header
}
MOST_KEPT = 64  # messages in `OriginalMessages`; older records are converted again


def to_message(record: Any, family: MessageFamily, frame_id: str = "world") -> Any:
    """Convert a record to its message.

    Args:
        frame_id: frame of the rig's world, for records in world coordinates.

    Raises:
        ContractError: if the record has no message.
    """
    write = _WRITERS.get(type(record).__name__)
    if write is None:
        raise ContractError(f"no message for {type(record).__name__}")
    return write(record, family, frame_id)


def from_message(message: Any, record: str) -> Any:
    """Convert a message of either family to its record.

    Args:
        record: name of the record's class; one message type may hold several record types.

    Raises:
        DataError: if the content is invalid (array lengths, NaN, zero sizes, ...).
        ContractError: if the record has no message.
    """
    if record not in _READERS:
        raise ContractError(f"no message for {record}")
    try:
        return _READERS[record](message)
    except (CalibrationError, ClockError) as error:  # raised by records that users also create from files
        raise DataError(str(error)) from None


class OriginalMessages:
    """Cache of the original messages of the newest received records.

    A record that is nested in another message is published as its original message, without a new conversion.

    Args:
        given: names of the records that are converted to messages. Only records nested in these are kept.
    """

    def __init__(self, given: Iterable[str] = ()):
        self._kinds = {_INSIDE[name] for name in given if name in _INSIDE}
        # by id of the record; the entry keeps the record alive, so the id stays unique
        self._kept: dict[int, tuple[Any, Any]] = {}

    def keep(self, record: Any, message: Any) -> None:
        """Keep the message from which a record was read."""
        if type(record).__name__ not in self._kinds:
            return
        self._kept[id(record)] = record, message
        if len(self._kept) > MOST_KEPT:
            del self._kept[next(iter(self._kept))]

    def of(self, record: Any) -> Any | None:
        """Return the original message of a record; None if it is not kept."""
        found = self._kept.get(id(record))
        return None if found is None else found[1]
