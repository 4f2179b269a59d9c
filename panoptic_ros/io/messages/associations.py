"""Association and tracks as messages, and back."""

from __future__ import annotations

from typing import Any

import numpy as np

from panoptic_ros.domain import AssociationSet, Evidence, Groups, Prediction, SubjectSet, TrackSet
from panoptic_ros.errors import DataError
from panoptic_ros.io.messages.arrays import flat, joint_count, shaped
from panoptic_ros.io.messages.detections import read_set, write_set
from panoptic_ros.io.messages.family import Messages, stamp_of

Array = np.ndarray
_PREDICTION = {  # field of the message: name in the record, shape behind people and joints, type
    "predicted_positions": ("positions", (3,), np.float64),
    "predicted_velocities": ("velocities", (3,), np.float64),
    "ages": ("ages", (), np.float64),
    "variances": ("variances", (3,), np.float64),
    "firm": ("firm", (), np.bool_),
}
_TRACKS = {"states": (6,), "variances": (3,), "ages": (), "unagreed": ()}  # shapes behind tracks and joints


def write(item: AssociationSet, family: Messages, frame_id: str) -> Any:
    """The message of an association set."""
    evidence, groups = item.evidence, item.groups
    return family.make(
        "AssociationSet",
        header=family.header(item.stamp_ns, frame_id),
        detections=family.origin(item.detections) or write_set(item.detections, family, frame_id),
        joint_count=evidence.scores.shape[1],
        cameras=flat(family, evidence.cameras, np.int32),
        slots=flat(family, evidence.slots, np.int32),
        delays=flat(family, evidence.delays, np.float64),
        view_people=flat(family, np.diff(evidence.starts), np.int32),
        rows=flat(family, evidence.rows, np.int32),
        plane=flat(family, evidence.plane, np.float64),
        magnification=flat(family, evidence.magnification, np.float64),
        scores=flat(family, evidence.scores, np.float64),
        members=flat(family, groups.member, np.int32),
        mirrored=flat(family, groups.mirrored, np.uint8),
        continues=flat(family, item.who, np.int32),
        places=flat(family, item.places, np.float64),
        lengths=flat(family, item.prediction.lengths, np.float64),
        **{
            field: flat(family, getattr(item.prediction, name), np.uint8 if dtype == np.bool_ else dtype)
            for field, (name, _, dtype) in _PREDICTION.items()
        },
    )


def read(message: Any) -> AssociationSet:
    """The record of an association set's message.

    Raises:
        DataError: if the arrays do not fit each other, or an index names what is not there.
    """
    evidence = _read_evidence(message)
    joints, views, people = evidence.scores.shape[1], evidence.views, len(message.continues)
    followed = len(message.ages) // max(joints, 1)
    prediction = Prediction(
        **{
            name: _array(message, field, dtype, followed, joints, *tail)
            for field, (name, tail, dtype) in _PREDICTION.items()
        },
        lengths=_lengths(message, "AssociationSet", followed),
    )
    groups = Groups(
        _array(message, "members", np.int64, people, views),
        _array(message, "mirrored", np.bool_, people, views),
    )
    who = _array(message, "continues", np.int64, people)
    detections = read_set(message.detections)
    _below("slots", evidence.slots, len(detections.views))
    _below("members", groups.member, len(evidence.view), -1)
    _below("continues", who, followed, -1)
    for view, slot in enumerate(evidence.slots):
        rows = evidence.rows[evidence.starts[view] : evidence.starts[view + 1]]
        _below("rows", rows, len(detections.views[slot].points))
    places = _array(message, "places", np.float64, people, joints, 3)
    return AssociationSet(detections, evidence, groups, who, places, prediction)


def _read_evidence(message: Any) -> Evidence:
    views, people, joints = len(message.cameras), len(message.rows), joint_count(message)
    counts = _array(message, "view_people", np.int64, views)
    if (counts < 0).any() or counts.sum() != people:
        raise DataError(f"AssociationSet.view_people names {counts.sum()} 2D people of {people}")
    cameras = _array(message, "cameras", np.int64, views)
    _below("cameras", cameras, 2**31)
    scores = _array(message, "scores", np.float64, people, joints)
    magnification = _array(message, "magnification", np.float64, people, joints)
    if scores.size and not (0.0 <= scores.min() <= scores.max() <= 1.0 and magnification.min() > 0.0):
        raise DataError("AssociationSet has scores outside of 0..1, or a magnification that is not positive")
    return Evidence(
        cameras,
        _array(message, "slots", np.int64, views),
        np.concatenate([[0], np.cumsum(counts)]),
        np.repeat(np.arange(views), counts),
        _array(message, "rows", np.int64, people),
        _array(message, "plane", np.float64, people, joints, 2),
        magnification,
        scores,
        _array(message, "delays", np.float64, views),
    )


def write_tracks(item: TrackSet, family: Messages, frame_id: str) -> Any:
    """The message of a track set."""
    return family.make(
        "TrackSet",
        header=family.header(item.stamp_ns, frame_id),
        index=item.index,
        skeleton_hash=item.skeleton_hash,
        joint_count=item.ages.shape[1],
        ids=flat(family, item.ids, np.int64),
        unseen=flat(family, item.unseen, np.float64),
        lengths=flat(family, item.lengths, np.float64),
        **{name: flat(family, getattr(item, name), np.float64) for name in _TRACKS},
    )


def read_tracks(message: Any) -> TrackSet:
    """The record of a track set's message.

    Raises:
        DataError: if the arrays do not fit each other.
    """
    people, joints = len(message.ids), joint_count(message)
    arrays = {
        name: np.array(shaped(getattr(message, name), f"TrackSet.{name}", people, joints, *tail), np.float64)
        for name, tail in _TRACKS.items()
    }
    return TrackSet(
        int(message.index),
        stamp_of(message.header),
        str(message.skeleton_hash),
        np.array(message.ids, np.int64),
        **arrays,
        unseen=np.array(shaped(message.unseen, "TrackSet.unseen", people), np.float64),
        lengths=_lengths(message, "TrackSet", people),
    )


def _lengths(message: Any, kind: str, people: int) -> Array:
    """Lengths (people, B) of bones; of none where the message has none."""
    bones = len(message.lengths) // max(people, 1)
    return np.array(shaped(message.lengths, f"{kind}.lengths", people, bones), np.float64)


def write_subjects(item: SubjectSet, family: Messages, frame_id: str) -> Any:
    """The message of who is designated."""
    return family.make(
        "SubjectSet",
        header=family.header(item.stamp_ns, frame_id),
        ids=flat(family, item.ids, np.int64),
        places=flat(family, item.places, np.float64),
        times=flat(family, item.times, np.int64),
        tracks=flat(family, item.tracks, np.int64),
    )


def read_subjects(message: Any) -> SubjectSet:
    """The record of a message that says who is designated; lists may be left out.

    Raises:
        DataError: if the arrays do not fit each other.
    """
    number, tails = len(message.ids), {"places": (3,), "times": (), "tracks": ()}
    given = {
        name: shaped(getattr(message, name), f"SubjectSet.{name}", number, *tail)
        for name, tail in tails.items()
        if len(getattr(message, name))
    }
    return SubjectSet(stamp_of(message.header), np.array(message.ids, np.int64), **given)


def _array(message: Any, field: str, dtype: Any, *shape: int) -> Array:
    """A field as an array of its own."""
    return np.array(shaped(getattr(message, field), f"AssociationSet.{field}", *shape), dtype)


def _below(field: str, values: Array, count: int, least: int = 0) -> None:
    """Raise DataError unless all indices are in least..count-1."""
    if values.size and not least <= values.min() <= values.max() < count:
        raise DataError(f"AssociationSet.{field} names {values.min()} to {values.max()}, of {count}")
