"""Every record of the graph as a message, and back."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from panoptic_ros.domain import (
    AudioBlock,
    ClockModel,
    DetectionSet,
    PoseSet,
    ProposalSet,
    RefinedPoseSet,
    Rig,
    ScoreMaps,
    SkeletonModel,
    TimecodeReading,
    TimeShift,
    TrackedPoseSet,
    ViewDetections,
    ViewSources,
    VisibilityLimit,
)
from panoptic_ros.errors import ContractError
from panoptic_ros.io.messages import statics
from panoptic_ros.io.messages.arrays import flat, shaped
from panoptic_ros.io.messages.family import Messages, stamp_of, time_ns

Array = np.ndarray
_NO_CELLS = np.zeros(0, np.uint16)
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
    return _READERS[record](message)


def _write_maps(maps: ScoreMaps | None, family: Messages) -> Any:
    if maps is None:
        empty = np.zeros(0, np.int32)
        maps = ScoreMaps((1, 1), np.eye(2, 3), empty, empty, empty.reshape(0, 2), empty.reshape(0, 2), empty)
    return family.make(
        "ScoreMaps",
        grid_width=maps.grid_size[0],
        grid_height=maps.grid_size[1],
        grid_from_image=np.array(maps.grid_from_image).reshape(6),
        joints=flat(family, maps.joints, np.int32),
        persons=flat(family, maps.persons, np.int32),
        corners=flat(family, maps.corners, np.int32),
        sizes=flat(family, maps.sizes, np.int32),
        data=flat(family, maps.data, np.uint8),
    )


def _read_maps(message: Any) -> ScoreMaps:
    count = len(message.joints)
    return ScoreMaps(
        (message.grid_width, message.grid_height),
        shaped(message.grid_from_image, "ScoreMaps.grid_from_image", 2, 3),
        message.joints,
        message.persons,
        shaped(message.corners, "ScoreMaps.corners", count, 2),
        shaped(message.sizes, "ScoreMaps.sizes", count, 2),
        message.data,
    )


def _write_view(view: ViewDetections, family: Messages, frame_id: str) -> Any:
    return family.make(
        "ViewDetections",
        header=family.header(view.stamp_ns, view.camera),
        frame_number=view.frame_number,
        image_width=view.image_size[0],
        image_height=view.image_size[1],
        skeleton_hash=view.skeleton_hash,
        person_count=len(view.person_scores),
        joint_count=view.points.shape[1],
        points=flat(family, view.points, np.float64),
        scores=flat(family, view.scores, np.float64),
        person_scores=flat(family, view.person_scores, np.float64),
        has_maps=view.maps is not None,
        maps=_write_maps(view.maps, family),
        limit_rows=0 if view.limit is None else view.limit.cells.shape[0],
        limit_columns=0 if view.limit is None else view.limit.cells.shape[1],
        limits=flat(family, _NO_CELLS if view.limit is None else view.limit.cells, np.uint16),
    )


def _read_view(message: Any) -> ViewDetections:
    people = int(message.person_count)
    joints = int(message.joint_count)
    return ViewDetections(
        str(message.header.frame_id),
        stamp_of(message.header),
        int(message.frame_number),
        (int(message.image_width), int(message.image_height)),
        str(message.skeleton_hash),
        shaped(message.points, "ViewDetections.points", people, joints, 2),
        shaped(message.scores, "ViewDetections.scores", people, joints),
        np.asarray(message.person_scores),
        _read_maps(message.maps) if message.has_maps else None,
        _read_limit(message),
    )


def _read_limit(message: Any) -> VisibilityLimit | None:
    shape = int(message.limit_rows), int(message.limit_columns)
    cells = shaped(message.limits, "ViewDetections.limits", *shape)
    return VisibilityLimit(cells) if cells.size else None


def _write_set(item: DetectionSet, family: Messages, frame_id: str) -> Any:
    return family.make(
        "DetectionSet",
        header=family.header(item.stamp_ns, frame_id),
        index=item.index,
        skeleton_hash=item.skeleton_hash,
        views=[_write_view(view, family, frame_id) for view in item.views],
    )


def _read_set(message: Any) -> DetectionSet:
    views = tuple(_read_view(view) for view in message.views)
    return DetectionSet(int(message.index), stamp_of(message.header), str(message.skeleton_hash), views)


def _write_proposals(item: ProposalSet, family: Messages, frame_id: str) -> Any:
    return family.make(
        "ProposalSet",
        header=family.header(item.stamp_ns, frame_id),
        detections=_write_set(item.detections, family, frame_id),
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
        _read_set(message.detections),
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
    skeletons = [
        family.make(
            "Skeleton",
            id=int(ids[k]),
            score=float(item.person_scores[k]),
            positions=flat(family, item.positions[k], np.float64),
            covariances=flat(family, item.covariances[k], np.float64),
            scores=flat(family, item.scores[k], np.float64),
            views=flat(family, item.views[k], np.int32),
            states=flat(family, item.states[k], np.uint8),
            view_persons=flat(family, (nothing if sources is None else sources.persons)[k], np.int32),
            **{
                field: flat(family, (nothing if shift is None else getattr(shift, name))[k], np.float64)
                for field, (name, _) in _TIME_SHIFT.items()
            },
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


def _read_poses(cls: type[PoseSet]) -> Callable[[Any], PoseSet]:
    def read(message: Any) -> PoseSet:
        people = message.skeletons
        joints = int(message.joint_count)
        shapes = {"positions": (3,), "covariances": (3, 3), "scores": (), "views": (), "states": ()}
        arrays = {
            name: np.array([shaped(getattr(p, name), f"Skeleton.{name}", joints, *tail) for p in people])
            .reshape(len(people), joints, *tail)
            for name, tail in shapes.items()
        }  # fmt: skip
        ids = {"ids": np.array([p.id for p in people], np.int64)} if issubclass(cls, TrackedPoseSet) else {}
        return cls(
            int(message.index), stamp_of(message.header), str(message.skeleton_hash),
            person_scores=np.array([p.score for p in people], float),
            newest_ns=time_ns(message.newest_stamp), time_shift=_read_time_shift(people, joints),
            sources=_read_sources(message), **arrays, **ids,
        )  # fmt: skip

    return read


def _read_time_shift(people: Any, joints: int) -> TimeShift | None:
    """None where no skeleton has one."""
    if not any(len(p.delays) for p in people):
        return None
    return TimeShift(
        *(
            np.array([shaped(getattr(p, field), f"Skeleton.{field}", joints, *tail) for p in people])
            for field, (_, tail) in _TIME_SHIFT.items()
        )
    )


def _read_sources(message: Any) -> ViewSources | None:
    """None where the message names no views."""
    cameras = tuple(str(name) for name in message.view_cameras)
    persons = [shaped(p.view_persons, "Skeleton.view_persons", len(cameras)) for p in message.skeletons]
    if not cameras:
        return None
    frames = shaped(message.view_frames, "Skeletons.view_frames", len(cameras))
    return ViewSources(cameras, frames, np.array(persons, np.int32).reshape(len(persons), len(cameras)))


_WRITERS: dict[type, Callable[[Any, Messages, str], Any]] = {
    ViewDetections: _write_view,
    DetectionSet: _write_set,
    ProposalSet: _write_proposals,
    PoseSet: _write_poses,
    SkeletonModel: statics.write_skeleton_model,
    Rig: statics.write_rig,
    AudioBlock: statics.write_audio,
    TimecodeReading: statics.write_timecode,
    ClockModel: statics.write_clock,
}
_READERS: dict[str, Callable[[Any], Any]] = {
    "ViewDetections": _read_view,
    "DetectionSet": _read_set,
    "ProposalSet": _read_proposals,
    "PoseSet": _read_poses(PoseSet),
    "TrackedPoseSet": _read_poses(TrackedPoseSet),
    "RefinedPoseSet": _read_poses(RefinedPoseSet),
    "SkeletonModel": statics.read_skeleton_model,
    "Rig": statics.read_rig,
    "AudioBlock": statics.read_audio,
    "TimecodeReading": statics.read_timecode,
    "ClockModel": statics.read_clock,
}
