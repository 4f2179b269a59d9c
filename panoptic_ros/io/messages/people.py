"""People and bodies as other packages know them: roots, TF of joints and segments, REP-155 bodies, boxes, and
sensor_msgs/JointState.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import numpy as np

from panoptic_ros.domain import BodyStateSet, JointState, SkeletonModel, TrackedPoseSet
from panoptic_ros.domain.body_names import joint_names, link_names
from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.geometry import Rigid
from panoptic_ros.geometry.rotations import from_quaternions
from panoptic_ros.geometry.torso import torso_frames
from panoptic_ros.io.messages.family import Messages
from panoptic_ros.io.messages.transforms import transform_message

Array = np.ndarray
TORSO = ("lShoulder", "rShoulder", "lHip", "rHip")
MARGIN_M = 0.1  # joints lie inside of a body: what a box has round them on every side


def body_name(person_id: int) -> str:
    """The id of a person as REP 155 has them: it begins with a letter."""
    return f"p{person_id}"


def roots_message(poses: TrackedPoseSet, skeleton: SkeletonModel, frame_id: str, family: Messages) -> Any:
    """geometry_msgs/PoseArray: of everybody whose root is known, in the order of the skeletons.

    Orientation: x forward, z up along the torso; none (w = 1) where the torso is not known.
    """
    poses_of = []
    for k in range(len(poses.ids)):
        frame = body_frame(poses, k, skeleton)
        if frame is not None:
            poses_of.append(_pose(frame, family))
    return family.make(
        "geometry_msgs/msg/PoseArray", header=family.header(poses.stamp_ns, frame_id), poses=poses_of
    )


def body_frame(poses: TrackedPoseSet, k: int, skeleton: SkeletonModel) -> Rigid | None:
    """The frame `body_<id>` of REP 155 in the world: origin between the hips, x out of the chest, z to the
    head; upright as the world where the torso is not known. None where the root is not known.
    """
    positions = poses.positions[k]
    names = skeleton.joint_names
    origin = positions[skeleton.root]
    corners = np.full((4, 3), np.nan)
    if set(TORSO) <= set(names):
        corners = positions[[names.index(name) for name in TORSO]]
    if np.isfinite(corners[2:]).all():
        origin = corners[2:].mean(axis=0)
    if not np.isfinite(origin).all():
        return None
    axes, _ = torso_frames(corners)
    return Rigid(axes if np.isfinite(axes).all() else np.eye(3), origin)


def joint_transforms(
    poses: TrackedPoseSet,
    skeleton: SkeletonModel,
    frame_id: str,
    prefix: str,
    family: Messages,
    solved: frozenset[int] = frozenset(),
) -> list[Any]:
    """A TransformStamped of every known joint, `<prefix>p<id>_<joint>`, turned as the world, and of every
    body, `<prefix>body_p<id>`, but of those whose segments are solved for, who have one from there.
    """
    found = []
    for k, person_id in enumerate(poses.ids.tolist()):
        name, frame = body_name(person_id), body_frame(poses, k, skeleton)
        if frame is not None and person_id not in solved:
            child = f"{prefix}body_{name}"
            found.append(transform_message(family, poses.stamp_ns, frame_id, child, frame))
        for j, position in _known(poses, k):
            joint = re.sub(r"[^A-Za-z0-9_]", "_", skeleton.joint_names[j])
            place = Rigid(np.eye(3), position)
            child = f"{prefix}{name}_{joint}"
            found.append(transform_message(family, poses.stamp_ns, frame_id, child, place))
    return found


def bodies_message(poses: TrackedPoseSet, frame_id: str, family: Messages) -> Any:
    """hri_msgs/IdsList of REP 155: who is there."""
    return family.make(
        "hri_msgs/msg/IdsList",
        header=family.header(poses.stamp_ns, frame_id),
        ids=[body_name(person_id) for person_id in poses.ids.tolist()],
    )


def boxes_message(poses: TrackedPoseSet, frame_id: str, family: Messages) -> Any:
    """vision_msgs/Detection3DArray: a box along the world's axes round the known joints of everybody."""
    detections = []
    for k, person_id in enumerate(poses.ids.tolist()):
        joints = np.array([position for _, position in _known(poses, k)])
        if not len(joints):
            continue
        low, high = joints.min(axis=0) - MARGIN_M, joints.max(axis=0) + MARGIN_M
        middle = _pose(Rigid(np.eye(3), (low + high) / 2), family)
        size = dict(zip("xyz", map(float, high - low)))
        hypothesis = family.make(
            "vision_msgs/msg/ObjectHypothesis", class_id="person", score=float(poses.person_scores[k])
        )
        spread = family.make(
            "geometry_msgs/msg/PoseWithCovariance", pose=middle, covariance=np.zeros(36, np.float64)
        )
        detections.append(
            family.make(
                "vision_msgs/msg/Detection3D",
                header=family.header(poses.stamp_ns, frame_id),
                results=[
                    family.make(
                        "vision_msgs/msg/ObjectHypothesisWithPose", hypothesis=hypothesis, pose=spread
                    )
                ],
                bbox=family.make(
                    "vision_msgs/msg/BoundingBox3D",
                    center=middle,
                    size=family.make("geometry_msgs/msg/Vector3", **size),
                ),
                id=body_name(person_id),
            )
        )
    header = family.header(poses.stamp_ns, frame_id)
    return family.make("vision_msgs/msg/Detection3DArray", header=header, detections=detections)


def joint_state_message(item: BodyStateSet, k: int, model: SegmentModel, family: Messages) -> Any:
    """sensor_msgs/JointState of the k-th body: angles, rad."""
    angles = model.joint_angles(from_quaternions(item.orientations[k]))
    body = body_name(int(item.ids[k]))
    nothing = family.sequence(np.zeros(0))
    return family.make(
        "sensor_msgs/msg/JointState",
        header=family.header(item.stamp_ns, f"body_{body}"),
        name=joint_names(model, body),
        position=family.sequence(np.ascontiguousarray(angles)),
        velocity=nothing,
        effort=nothing,
    )


def segment_transforms(
    item: BodyStateSet, model: SegmentModel, frame_id: str, prefix: str, family: Messages
) -> list[Any]:
    """A TransformStamped of every segment of every body in its parent's frame, of the root in the world."""
    found = []
    for k, number in enumerate(item.ids.tolist()):
        frames, places = from_quaternions(item.orientations[k]), item.positions[k]
        names = [prefix + name for name in link_names(model, body_name(number))]
        for s, above in enumerate(model.parents.tolist()):
            pose = Rigid(frames[s], places[s])
            if s:
                pose = Rigid(frames[above].T @ frames[s], frames[above].T @ (places[s] - places[above]))
            parent = names[above] if s else frame_id
            found.append(transform_message(family, item.stamp_ns, parent, names[s], pose))
    return found


def _known(poses: TrackedPoseSet, k: int) -> Iterator[tuple[int, Array]]:
    for j in np.flatnonzero(poses.states[k] != JointState.MISSING):
        yield int(j), poses.positions[k, j]


def _pose(frame: Rigid, family: Messages) -> Any:
    """geometry_msgs/Pose."""
    transform = transform_message(family, 0, "", "", frame).transform
    at = transform.translation
    return family.make(
        "geometry_msgs/msg/Pose",
        position=family.make("geometry_msgs/msg/Point", x=at.x, y=at.y, z=at.z),
        orientation=transform.rotation,
    )
