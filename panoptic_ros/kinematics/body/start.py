"""Initial pose of a person, without a previous pose."""

from __future__ import annotations

import math

import numpy as np

from panoptic_ros.domain.subjects import Subject
from panoptic_ros.geometry.chain import Pose
from panoptic_ros.geometry.rotations import rotations_of, turn_about_z
from panoptic_ros.kinematics.body.evidence import EvidenceBuilder
from panoptic_ros.kinematics.body.sight import People
from panoptic_ros.kinematics.pose.solve import solve_pose
from panoptic_ros.kinematics.pose.targets import no_anchor

Array = np.ndarray
HEADINGS = 8
ITERATIONS = 60
ARM_DOWN = 1.2  # rad, of the upper arms below the T posture
PELVIS_SHARE = 0.53  # fraction of the stature: height of the pelvis where no data determine it


def first_pose(
    weighing: EvidenceBuilder,
    subject: Subject,
    people: People,
    oriented: tuple[Array, Array],
    joints: tuple[Array, Array] | None = None,
) -> Pose:
    """Return the pose of least cost, from several initial poses.

    Where no IMU measures the orientation of the root segment, the initial poses have several headings.

    Args:
        people: Points (K, 2) on the normalised image plane and scores (K,) by camera.
        oriented: Segments (N,) of known orientation, and these orientations (N, 3, 3).
        joints: 3D joints, where there are no 2D joints: positions (K, 3) m and covariances (K, 3, 3) m^2.
    """
    chain, (segments, goals) = subject.body.chain, oriented
    root = _root(weighing, subject, people, joints)
    views = weighing.views(people, root)
    turns = weighing.turns(segments, goals, np.full(len(segments), math.radians(5.0)))
    evidence = weighing.evidence(views, turns, weighing.points(joints))
    size = 3 + 3 * len(chain.parents)
    best, least = None, math.inf
    for pose in _candidates(subject, root, segments, goals):
        cost, _ = solve_pose(
            chain, pose, evidence, no_anchor(len(chain.parents)), ITERATIONS, np.empty((size, size))
        )
        if cost < least:
            best, least = pose, cost
    assert best is not None
    return best


def _candidates(subject: Subject, root: Array, segments: Array, goals: Array) -> list[Pose]:
    """Return initial poses: one from IMU orientations, or upright poses, arms down, in several headings."""
    model = subject.body.model
    known = {int(s): goal for s, goal in zip(segments, goals)}
    if 0 in known:
        frames: list[Array] = []
        turns = np.empty((len(model.names), 3, 3))
        for s, parent in enumerate(model.parents):
            above = frames[parent] if parent >= 0 else np.eye(3)
            frames.append(known.get(s, above))
            turns[s] = above.T @ frames[s]
        return [Pose(root.copy(), turns)]
    found = []
    for k in range(HEADINGS):
        turns = np.tile(np.eye(3), (len(model.names), 1, 1))
        turns[0] = turn_about_z(2.0 * math.pi * k / HEADINGS)
        for name, side in (("lUpperArm", 1.0), ("rUpperArm", -1.0)):
            if name in model.names:
                turns[model.index(name)] = rotations_of(np.array([[-side * ARM_DOWN, 0.0, 0.0]]))[0]
        found.append(Pose(root.copy(), turns))
    return found


def middle_of(weighing: EvidenceBuilder, people: People, joints: tuple[Array, Array] | None) -> Array | None:
    """Return the middle (3,) m of a person's joints, or None.

    It is the median of the 3D joints, if these are given. Otherwise it is the point nearest to the rays to
    the middles of the 2D poses; with fewer than two views it is None.
    """
    if joints is not None:
        return _median(joints[0][weighing.sites[0]])
    if len(people) < 2:
        return None
    matrix, vector = _rays(weighing, people)
    found: Array = np.linalg.solve(matrix + 1e-9 * np.eye(3), vector)
    return found


def _median(joints: Array) -> Array | None:
    known = joints[np.isfinite(joints).all(-1)]
    return np.median(known, axis=0) if len(known) else None


def _rays(weighing: EvidenceBuilder, people: People) -> tuple[Array, Array]:
    """Return the normal equations (3, 3), (3,) of the point nearest to the rays.

    There is one ray per view, to the middle of the 2D pose.
    """
    matrix, vector = np.zeros((3, 3)), np.zeros(3)
    for camera, (points, _) in people.items():
        seen = points[np.isfinite(points).all(-1)]
        if len(seen):
            rotation = weighing.rotations[camera]
            ray = rotation.T @ np.append(np.median(seen, axis=0), 1.0)
            ray /= np.linalg.norm(ray)
            across = np.eye(3) - np.outer(ray, ray)
            matrix += across
            vector += across @ (-rotation.T @ weighing.translations[camera])
    return matrix, vector


def _root(
    weighing: EvidenceBuilder,
    subject: Subject,
    people: People,
    joints: tuple[Array, Array] | None,
) -> Array:
    """Return the approximate position (3,) m of the pelvis.

    It is the middle of the visible joints, else the stated start. Without both, it is at a usual height, near
    the ray of a single view if there is one.
    """
    middle = middle_of(weighing, people, joints)
    if middle is not None:
        return middle
    if subject.start is not None:
        return np.array(subject.start, float)
    height = PELVIS_SHARE * float(np.linalg.norm(subject.body.offsets, axis=-1).sum() / 2.6)
    if not people:
        return np.array([0.0, 0.0, height])
    matrix, vector = _rays(weighing, people)
    stiff = matrix + 1e-3 * np.eye(3)
    stiff[2, 2] += 10.0
    found: Array = np.linalg.solve(stiff, vector + np.array([0.0, 0.0, 10.0 * height]))
    return found
