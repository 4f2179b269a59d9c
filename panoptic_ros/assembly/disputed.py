"""Joints of people whom few views show, where these views disagree or only one of them has the joint.

With many views, a joint on which no two views agree is better left out. With two views, each error of one
of them would lose the joint, and with a shoulder the torso. So a joint that two views see is placed between
their rays if these are close enough. A joint that one view sees is placed on its ray, where the bone to a
neighbour is as long as that of the other side. Their covariances are large.
"""
from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from panoptic_ros.assembly.judgement import Joints
from panoptic_ros.domain import SkeletonModel
from panoptic_ros.solving.joint_records import Candidates
from panoptic_ros.solving.scene import Scene, seeing_views

Array = np.ndarray

WIDEST_GAP = 0.25  # m, between two rays
FEW_VIEWS = 2  # people of more views are left as they are
FEW_SEEING = 3  # so are people whom more views should see, as they may be false
PIXEL_SIGMA = 0.03  # m, across a ray
LENGTH_SIGMA = 0.05  # m, along a ray, by which a bone differs from that of the other side
CLOSE = 0.15  # m, between the joints of a head
OUTWARDS = 2  # bones along which joints are placed
STRETCH = 1.3  # a ray may pass this much farther away than the bone is long


@dataclass(frozen=True, slots=True)
class Ray:
    """Where a view sees a joint: origin (3,) m, unit direction (3,), score of the observation."""

    origin: Array
    direction: Array
    score: float


def place_disputed(scene: Scene, found: Candidates, joints: Joints, skeleton: SkeletonModel) -> None:
    """Fill missing joints of people of few views, in place, with what belongs to them."""
    member, expected = found.grouping.member, found.guide.positions
    supporting = (member >= 0).sum(axis=1)
    lacking = np.isnan(joints.positions[..., 0]).any(axis=1)
    few = np.flatnonzero(lacking & (supporting >= 1) & (supporting <= FEW_VIEWS))
    few = few[seeing_views(scene, joints.positions[few]).sum(axis=1) <= FEW_SEEING]
    for p in few:
        positions = joints.positions[p]
        missing = np.flatnonzero(np.isnan(positions[:, 0])).tolist()
        rays = {j: _rays(scene, member[p], found.source[p], j) for j in missing}
        for joint, seen in rays.items():
            if len(seen) >= 2:
                _put(joints, p, joint, between(seen[0], seen[1]), seen)
        for _ in range(OUTWARDS):  # from known joints to those that are linked to them
            for joint, seen in rays.items():
                if len(seen) == 1 and np.isnan(positions[joint, 0]):
                    place = along_bone(seen[0], joint, expected[p, joint], positions, skeleton)
                    _put(joints, p, joint, place, seen)


def between(first: Ray, second: Ray) -> tuple[Array, Array] | None:
    """Point midway between two rays and its covariance; None if they pass too far or behind a camera."""
    cosine = float(first.direction @ second.direction)
    offset = second.origin - first.origin
    sine = 1.0 - cosine**2
    if sine < 1e-3:
        return None
    a = (offset @ first.direction - cosine * (offset @ second.direction)) / sine
    b = (cosine * (offset @ first.direction) - offset @ second.direction) / sine
    ends = np.stack([first.origin + a * first.direction, second.origin + b * second.direction])
    gap = float(np.linalg.norm(ends[1] - ends[0]))
    if a <= 0.0 or b <= 0.0 or gap > WIDEST_GAP:
        return None
    return ends.mean(axis=0), ((0.5 * gap) ** 2 + PIXEL_SIGMA**2 / sine) * np.eye(3)


def along_bone(
    ray: Ray, joint: int, expected: Array, positions: Array, skeleton: SkeletonModel
) -> tuple[Array, Array] | None:
    """Point on a ray where a bone has the length of that of the other side, and its covariance.

    Of two such points the one nearer to where the joint is expected; without that, the middle of both.
    """
    for end, length in _bones_of_other_side(joint, positions, skeleton):
        depth = float((positions[end] - ray.origin) @ ray.direction)
        passing = float(np.linalg.norm(ray.origin + depth * ray.direction - positions[end]))
        if depth <= 0.0 or passing > STRETCH * length:
            continue
        half = float(np.sqrt(max(length**2 - passing**2, 0.0)))
        depths = depth + np.array([-half, half])
        spread = LENGTH_SIGMA
        if np.isfinite(expected[0]):
            depth = float(depths[np.abs(depths - (expected - ray.origin) @ ray.direction).argmin()])
        else:
            spread = float(np.hypot(spread, half))
        along = np.outer(ray.direction, ray.direction)
        return ray.origin + depth * ray.direction, spread**2 * along + PIXEL_SIGMA**2 * (np.eye(3) - along)
    return _beside_neighbour(ray, joint, positions, skeleton)


def _beside_neighbour(
    ray: Ray, joint: int, positions: Array, skeleton: SkeletonModel
) -> tuple[Array, Array] | None:
    """Where a ray passes closest to a neighbour of the joint, if that is as close as joints of a head are."""
    for bone in skeleton.bones:
        if joint not in bone:
            continue
        end = positions[bone[1] if bone[0] == joint else bone[0]]
        depth = float((end - ray.origin) @ ray.direction)
        passing = float(np.linalg.norm(ray.origin + depth * ray.direction - end))
        if depth > 0.0 and passing < CLOSE:  # False for NaN
            along = np.outer(ray.direction, ray.direction)
            return ray.origin + depth * ray.direction, CLOSE**2 * along + PIXEL_SIGMA**2 * (np.eye(3) - along)
    return None


def _bones_of_other_side(
    joint: int, positions: Array, skeleton: SkeletonModel
) -> Iterator[tuple[int, float]]:
    """Neighbours of a joint that are there, with the length of the same bone on the other side."""
    mirror = skeleton.mirror
    for bone in skeleton.bones:
        if joint not in bone:
            continue
        end = bone[1] if bone[0] == joint else bone[0]
        length = float(np.linalg.norm(positions[mirror[joint]] - positions[mirror[end]]))
        if mirror[joint] != joint and np.isfinite(length + positions[end, 0]):
            yield end, length


def _rays(scene: Scene, member: Array, source: Array, joint: int) -> list[Ray]:
    """The rays on which the views see a joint of a person with 2D people member (V,)."""
    evidence = scene.evidence
    rays = []
    for view in np.flatnonzero(member >= 0):
        row, own = member[view], source[view, joint]
        if scene.precision[row, own] <= 0.0:
            continue
        direction = np.append(evidence.plane[row, own], 1.0) @ scene.cams.rotations[view]
        direction = direction / np.linalg.norm(direction)
        rays.append(Ray(scene.centres[view], direction, float(evidence.scores[row, own])))
    return rays


def _put(joints: Joints, p: int, joint: int, place: tuple[Array, Array] | None, seen: list[Ray]) -> None:
    """Write a joint of person p with the scores of its rays; nothing where no place was found."""
    if place is not None:
        joints.positions[p, joint], joints.covariances[p, joint] = place
        joints.scores[p, joint] = float(np.mean([ray.score for ray in seen]))
        joints.views[p, joint] = len(seen)
