"""Every record of the graph as a message, and back."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from panoptic_ros.domain import (
    AssociationSet,
    AudioBlock,
    ClockModel,
    DetectionSet,
    PatchTracks,
    PatchTrajectories,
    PoseSet,
    Preview,
    ProposalSet,
    RefinedPoseSet,
    Rig,
    SkeletonModel,
    SubjectSet,
    TimecodeReading,
    TimeShift,
    TrackedPoseSet,
    TrackSet,
    ViewAppearance,
    ViewDetections,
    ViewSources,
)
from panoptic_ros.domain.bodies import BodyStateSet, ImuSample
from panoptic_ros.errors import CalibrationError, ClockError, ContractError, DataError
from panoptic_ros.io.messages import appearance, associations, bodies, detections, images, patches, statics
from panoptic_ros.io.messages.arrays import flat, joint_count, shaped
from panoptic_ros.io.messages.family import Messages, stamp_of, time_ns

Array = np.ndarray
_NO_FRAMES = np.zeros(0, np.uint64)


def to_message(record: Any, family: Messages, frame_id: str = "world") -> Any:
    """The message of a record.

    Args:
        frame_id: the rig's world frame, for records that live in it.
    """
    for cls, write in _WRITERS.items():
        if isinstance(record, cls):
            return write(record, family, frame_id)
    raise ContractError(f"no message for {type(record).__name__}")


def from_message(message: Any, record: str) -> Any:
    """The record of a message of either family.

    Args:
        record: name of the record's class; one message type may carry several.

    Raises:
        DataError: if the content is bad (array lengths, NaN, zero sizes, ...).
    """
    if record not in _READERS:
        raise ContractError(f"no message for {record}")
    try:
        return _READERS[record](message)
    except (CalibrationError, ClockError) as error:  # of records that people make, too
        raise DataError(str(error)) from None


def _write_proposals(item: ProposalSet, family: Messages, frame_id: str) -> Any:
    return family.make(
        "ProposalSet",
        header=family.header(item.stamp_ns, frame_id),
        association=family.origin(item.association) or associations.write(item.association, family, frame_id),
        nodes=flat(family, item.nodes, np.float64),
        node_joints=flat(family, item.node_joints, np.int32),
        node_scores=flat(family, item.node_scores, np.float64),
        node_views=flat(family, item.node_views, np.int32),
        parts=flat(family, item.parts, np.int32),
        part_bones=flat(family, item.part_bones, np.int32),
        part_scores=flat(family, item.part_scores, np.float64),
    )


def _read_proposals(message: Any) -> ProposalSet:
    nodes, parts = len(message.node_joints), len(message.part_bones)
    return ProposalSet(
        associations.read(message.association),
        shaped(message.nodes, "ProposalSet.nodes", nodes, 3),
        np.asarray(message.node_joints),
        np.asarray(message.node_scores),
        np.asarray(message.node_views),
        shaped(message.parts, "ProposalSet.parts", parts, 2),
        np.asarray(message.part_bones),
        np.asarray(message.part_scores),
    )


_TIME_SHIFT = {  # field of the message: name in the record, shape behind the joints
    "delays": ("delays", (3, 3)),
    "assumed_velocities": ("assumed", (3,)),
    "velocities": ("velocities", (3,)),
    "velocity_information": ("information", (3, 3)),
}


def _write_poses(item: PoseSet, family: Messages, frame_id: str) -> Any:
    ids = item.ids if isinstance(item, TrackedPoseSet) else np.full(len(item.positions), -1)
    shift, sources = item.time_shift, item.sources
    nothing = np.zeros((len(ids), 0))
    persons = nothing if sources is None else sources.persons
    given = {"side_votes": item.side_votes, "corrections": item.corrections}
    given |= {field: getattr(shift, name, None) for field, (name, _) in _TIME_SHIFT.items()}
    optional = {field: nothing if values is None else values for field, values in given.items()}
    plain = {"positions": item.positions, "covariances": item.covariances, "scores": item.scores}
    rows = {field: _by_person(values, np.float64) for field, values in {**plain, **optional}.items()}
    rows |= {"views": _by_person(item.views, np.int32), "view_persons": _by_person(persons, np.int32)}
    rows["states"] = _by_person(item.states, np.uint8)
    skeletons = [
        family.make(
            "Skeleton",
            id=int(ids[k]),
            score=float(item.person_scores[k]),
            **{field: family.sequence(values[k]) for field, values in rows.items()},
        )
        for k in range(len(ids))
    ]
    return family.make(
        "Skeletons",
        header=family.header(item.stamp_ns, frame_id),
        newest_stamp=family.header(item.newest_ns, frame_id).stamp,
        index=item.index,
        skeleton_hash=item.skeleton_hash,
        joint_count=item.positions.shape[1],
        view_cameras=[] if sources is None else list(sources.cameras),
        view_frames=flat(family, _NO_FRAMES if sources is None else sources.frames, np.uint64),
        skeletons=skeletons,
    )


def _by_person(values: Array, dtype: Any) -> Array:
    array = np.ascontiguousarray(values, dtype)
    return array.reshape(len(array), math.prod(array.shape[1:]))


def _read_poses(cls: type[PoseSet]) -> Callable[[Any], PoseSet]:
    def read(message: Any) -> PoseSet:
        people = message.skeletons
        joints = joint_count(message)
        shapes = {"positions": (3,), "covariances": (3, 3), "scores": (), "views": (), "states": ()}
        arrays = {name: _of_all(people, name, joints, *tail) for name, tail in shapes.items()}
        ids = {"ids": np.array([p.id for p in people], np.int64)} if issubclass(cls, TrackedPoseSet) else {}
        return cls(
            int(message.index),
            stamp_of(message.header),
            str(message.skeleton_hash),
            person_scores=np.array([p.score for p in people], float),
            newest_ns=time_ns(message.newest_stamp),
            time_shift=_read_time_shift(people, joints),
            sources=_read_sources(message),
            side_votes=_read_side_votes(people),
            corrections=_read_corrections(people, joints),
            **arrays,
            **ids,
        )

    return read


def _read_time_shift(people: Any, joints: int) -> TimeShift | None:
    """None where no skeleton has one."""
    if not any(len(p.delays) for p in people):
        return None
    return TimeShift(*(_of_all(people, field, joints, *tail) for field, (_, tail) in _TIME_SHIFT.items()))


def _read_side_votes(people: Any) -> Array | None:
    """None where no skeleton has any."""
    if not any(len(p.side_votes) for p in people):
        return None
    return _of_all(people, "side_votes", len(people[0].side_votes))


def _read_corrections(people: Any, joints: int) -> Array | None:
    """None where no skeleton has any."""
    if not any(len(p.corrections) for p in people):
        return None
    return _of_all(people, "corrections", joints, 3)


def _read_sources(message: Any) -> ViewSources | None:
    """None where the message names no views."""
    cameras = tuple(str(name) for name in message.view_cameras)
    persons = _of_all(message.skeletons, "view_persons", len(cameras))
    if not cameras:
        return None
    frames = shaped(message.view_frames, "Skeletons.view_frames", len(cameras))
    return ViewSources(cameras, frames, persons.astype(np.int32, copy=False))


def _of_all(people: Any, field: str, *shape: int) -> Array:
    """A field of all skeletons, with the people in front."""
    wanted, values = math.prod(shape), [getattr(person, field) for person in people]
    for each in values:
        if len(each) != wanted:
            shaped(each, f"Skeleton.{field}", *shape)
    return shaped(np.concatenate(values) if values else (), f"Skeleton.{field}", len(values), *shape)


_WRITERS: dict[type, Callable[[Any, Messages, str], Any]] = {
    ViewDetections: detections.write_view,
    DetectionSet: detections.write_set,
    AssociationSet: associations.write,
    TrackSet: associations.write_tracks,
    SubjectSet: associations.write_subjects,
    ProposalSet: _write_proposals,
    PatchTracks: patches.write_tracks,
    ViewAppearance: appearance.write_appearance,
    PatchTrajectories: patches.write_trajectories,
    PoseSet: _write_poses,
    SkeletonModel: statics.write_skeleton_model,
    Rig: statics.write_rig,
    AudioBlock: statics.write_audio,
    TimecodeReading: statics.write_timecode,
    ClockModel: statics.write_clock,
    Preview: images.write_preview,
    BodyStateSet: bodies.write_bodies,
    ImuSample: bodies.write_imu,
}
_READERS: dict[str, Callable[[Any], Any]] = {
    "ViewDetections": detections.read_view,
    "Preview": images.read_preview,
    "DetectionSet": detections.read_set,
    "AssociationSet": associations.read,
    "TrackSet": associations.read_tracks,
    "SubjectSet": associations.read_subjects,
    "ProposalSet": _read_proposals,
    "PatchTracks": patches.read_tracks,
    "ViewAppearance": appearance.read_appearance,
    "PatchTrajectories": patches.read_trajectories,
    "PoseSet": _read_poses(PoseSet),
    "TrackedPoseSet": _read_poses(TrackedPoseSet),
    "RefinedPoseSet": _read_poses(RefinedPoseSet),
    "SkeletonModel": statics.read_skeleton_model,
    "Rig": statics.read_rig,
    "AudioBlock": statics.read_audio,
    "TimecodeReading": statics.read_timecode,
    "ClockModel": statics.read_clock,
    "BodyStateSet": bodies.read_bodies,
    "ImuSample": lambda message: bodies.read_imu(message, str(message.header.frame_id)),
}
