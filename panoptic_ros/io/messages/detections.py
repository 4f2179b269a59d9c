"""2D people as messages, and back."""

from __future__ import annotations

from typing import Any

import numpy as np

from panoptic_ros.domain import DetectionSet, ScoreMaps, ViewDetections, VisibilityLimit
from panoptic_ros.io.messages.arrays import flat, joint_count, shaped
from panoptic_ros.io.messages.family import Messages, stamp_of

_NO_CELLS = np.zeros(0, np.uint16)
_NO_TIMES = np.zeros(0)


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


def write_view(view: ViewDetections, family: Messages, frame_id: str) -> Any:
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
        carried=flat(family, _NO_TIMES if view.carried is None else view.carried, np.float64),
    )


def read_view(message: Any) -> ViewDetections:
    people = int(message.person_count)
    joints = joint_count(message)
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
        np.asarray(message.carried) if len(message.carried) else None,
    )


def _read_limit(message: Any) -> VisibilityLimit | None:
    shape = int(message.limit_rows), int(message.limit_columns)
    cells = shaped(message.limits, "ViewDetections.limits", *shape)
    return VisibilityLimit(cells) if cells.size else None


def write_set(item: DetectionSet, family: Messages, frame_id: str) -> Any:
    return family.make(
        "DetectionSet",
        header=family.header(item.stamp_ns, frame_id),
        index=item.index,
        skeleton_hash=item.skeleton_hash,
        views=[family.origin(view) or write_view(view, family, frame_id) for view in item.views],
    )


def read_set(message: Any) -> DetectionSet:
    views = tuple(read_view(view) for view in message.views)
    return DetectionSet(int(message.index), stamp_of(message.header), str(message.skeleton_hash), views)
