"""Convert people and bodies to messages of other packages.

These are root poses, TF of joints and segments, REP-155 bodies, bounding boxes and sensor_msgs/JointState.
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
from panoptic_ros.io.messages.family import MessageFamily
from panoptic_ros.io.messages.transforms import transform_message

Array = np.ndarray
TORSO = ("lShoulder", "rShoulder", "lHip", "rHip")
MARGIN_M = 0.1  # margin of a bounding box on every side, because joints lie inside the body


def body_name(person_id: int) -> str:
    """Return the REP-155 id of a person, which begins with a letter."""
    return f"p{person_id}"


def roots_message(
    poses: TrackedPoseSet, skeleton: SkeletonModel, frame_id: str, family: MessageFamily
) -> Any:
    """Build a geometry_msgs/PoseArray of all people with a known root, in the order of the 3D poses.

    The orientation has x forward and z up along the torso; it is the identity (w = 1) if the torso is
    unknown.
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
    """Return the pose in the world of the REP-155 frame `body_<id>`; None if the root is unknown.

    The origin lies between the hips, x points out of the chest, z to the head. If the torso is unknown, the
    axes are those of the world.
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
    family: MessageFamily,
    solved: frozenset[int] = frozenset(),
) -> list[Any]:
    """Build a TransformStamped for every known joint and for every body.

    Joint frames `<prefix>p<id>_<joint>` have the orientation of the world. Body frames are
    `<prefix>body_p<id>`.

    Args:
        solved: ids of people whose segments are solved; `segment_transforms` publishes their body frame.
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


def bodies_message(poses: TrackedPoseSet, frame_id: str, family: MessageFamily) -> Any:
    """Build the hri_msgs/IdsList of REP 155 with the ids of all people."""
    return family.make(
        "hri_msgs/msg/IdsList",
        header=family.header(poses.stamp_ns, frame_id),
        ids=[body_name(person_id) for person_id in poses.ids.tolist()],
    )


def boxes_message(poses: TrackedPoseSet, frame_id: str, family: MessageFamily) -> Any:
    """Build a vision_msgs/Detection3DArray: an axis-aligned box around the known joints of each person."""
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


def joint_state_message(item: BodyStateSet, k: int, model: SegmentModel, family: MessageFamily) -> Any:
    """Build the sensor_msgs/JointState of the k-th body: joint angles, rad."""
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
    item: BodyStateSet, model: SegmentModel, frame_id: str, prefix: str, family: MessageFamily
) -> list[Any]:
    """Build a TransformStamped of every segment of all bodies, in the frame of its parent.

    The parent frame of the root segment is the world frame.
    """
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


def _pose(frame: Rigid, family: MessageFamily) -> Any:
    """Build a geometry_msgs/Pose."""
    transform = transform_message(family, 0, "", "", frame).transform
    at = transform.translation
    return family.make(
        "geometry_msgs/msg/Pose",
        position=family.make("geometry_msgs/msg/Point", x=at.x, y=at.y, z=at.z),
        orientation=transform.rotation,
    )
