"""Checks of records from other nodes before the stages process them: they must fit the rig and the skeleton.

Compiled kernels do not check indices, so indices beyond the cameras or joints must not reach them.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from panoptic_ros.domain import (
    AssociationSet,
    PoseSet,
    ProposalSet,
    Rig,
    SkeletonModel,
    TrackSet,
    ViewDetections,
    ViewFrame,
)
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.errors import DataError
from panoptic_ros.geometry.lens_kernels import undistort_points


def check_record(record: object, owner: str, rig: Rig, skeleton: SkeletonModel) -> None:
    """Check that a record is of its topic's camera and fits the rig and the skeleton model.

    Args:
        owner: Camera, sensor or device of the topic. "" for topics of the graph.

    Raises:
        DataError: names the difference.
    """
    if isinstance(record, (ViewFrame, ViewDetections)):
        _check_view(record, owner, rig)
    if isinstance(record, ProposalSet):
        _check_proposals(record, skeleton)
        record = record.association
    if isinstance(record, AssociationSet):
        _check_cameras(record, rig)
        _check_evidence(record, rig)
    joints, expected = _joints(record), len(skeleton.joint_names)
    if joints not in (None, expected):
        of = f" of camera {owner}" if owner else ""
        raise DataError(f"a {type(record).__name__}{of} has {joints} joints, {skeleton.name} has {expected}")


def _joints(record: object) -> int | None:
    """Return the number of joints of the poses in a record; None if it contains none."""
    if isinstance(record, ViewDetections):
        return int(record.points.shape[1])
    if isinstance(record, PoseSet):
        return int(record.positions.shape[1])
    if isinstance(record, TrackSet):
        return int(record.ages.shape[1])
    return int(record.evidence.scores.shape[1]) if isinstance(record, AssociationSet) else None


def _check_view(view: ViewFrame | ViewDetections, camera: str, rig: Rig) -> None:
    if view.camera != camera:
        raise DataError(f"a message of camera {view.camera!r} came on a topic of {camera}")
    calibrated = rig.camera(camera).image_size
    if view.image_size != calibrated:
        sizes = [f"{width} x {height}" for width, height in (view.image_size, calibrated)]
        raise DataError(f"images of camera {camera} are {sizes[0]}, but it is calibrated for {sizes[1]}")


def _check_cameras(item: AssociationSet, rig: Rig) -> None:
    """Check that the evidence of each view names the camera of that view, in the order of the rig."""
    named = [item.detections.views[slot].camera for slot in item.evidence.slots]
    given = item.evidence.cameras
    if [rig.names[k] if k < len(rig.names) else "" for k in given] != named or (np.diff(given) <= 0).any():
        raise DataError(
            f"an AssociationSet names cameras {given.tolist()} of the rig for its views of {', '.join(named)}"
        )


@lru_cache(maxsize=2)
def _arrays(rig: Rig) -> RigArrays:
    return RigArrays.of(rig)


def _check_evidence(item: AssociationSet, rig: Rig) -> None:
    """Check that the evidence agrees with its 2D poses, because noise tables learn from it permanently."""
    found, views = item.evidence, [item.detections.views[slot] for slot in item.evidence.slots]
    for v, view in enumerate(views):
        rows = found.rows[found.starts[v] : found.starts[v + 1]]
        if rows.size and not 0 <= rows.min() <= rows.max() < len(view.points):
            raise DataError(f"an AssociationSet names people of camera {view.camera} that its view lacks")
    if not len(found.rows):
        return
    parts = [
        view.points[found.rows[begin:end]]
        for view, begin, end in zip(views, found.starts[:-1], found.starts[1:])
    ]
    pixels = np.concatenate(parts)
    usable = (found.scores > 0.0) & np.isfinite(pixels).all(-1)
    plane, magnification, _ = undistort_points(pixels, usable, found.cameras[found.view], _arrays(rig).lenses)
    for name, given, expected in (
        ("plane", found.plane[usable], plane[usable]),
        ("magnification", found.magnification[usable], magnification[usable]),
    ):
        apart = np.abs(given - expected)
        if not (apart <= 1e-9 + 1e-6 * np.abs(expected)).all():
            farthest = float(apart.max())
            raise DataError(f"Evidence.{name} differs by {farthest:.3g} from that of its 2D people")
    stamp = item.detections.stamp_ns
    delays = np.array([1e-9 * (view.stamp_ns - stamp) for view in views])
    if not ((found.delays == 0.0) | (np.abs(found.delays - delays) < 1e-6)).all():
        raise DataError("Evidence.delays differ from the stamps of its views")


def _check_proposals(item: ProposalSet, skeleton: SkeletonModel) -> None:
    for name, values, least, count in (
        ("node_joints", item.node_joints, 0, len(skeleton.joint_names)),
        ("part_bones", item.part_bones, -1, len(skeleton.bones)),
    ):
        if values.size and not least <= values.min() <= values.max() < count:
            raise DataError(f"ProposalSet.{name} names {values.min()} to {values.max()}, of {count}")
