"""Occlusion of joints by bodies, according to the skeletons.

Detectors guess hidden joints, with several times the noise of visible ones and often with a high score. The
noise of hidden joints is learnt online (see `noise`). This module contains geometry only: a body consists of
its thickened bones.
"""

from __future__ import annotations

import numpy as np

from panoptic_ros.domain import SkeletonModel
from panoptic_ros.kernels import njit
from panoptic_ros.solving.joint_records import PersonCandidates
from panoptic_ros.solving.scene import MIN_DEPTH, CameraPoses, seen_at

Array = np.ndarray

BONE_RADIUS = 0.05  # m, radius of a bone
TRUNK_RADIUS = 0.09  # m, radius of the flanks: shoulder to hip of one side
OWN_FACTOR = 0.7  # factor on the radius of a bone that may hide joints of its own body
CORE, RIM = 0.8, 1.3  # shares of a radius: joints are hidden within CORE, perhaps hidden within RIM
AHEAD = 0.06  # m, least distance of a hiding bone in front of the joint


def body_bones(skeleton: SkeletonModel, torso: tuple[tuple[int, int], ...] | None) -> tuple[Array, Array]:
    """Return the bones (B, 2) that hide others, and their radii (B,) m.

    They are the bones of the skeleton, and the flanks.

    Args:
        torso: Shoulders and hips, each (left, right), or None if the skeleton has none.
    """
    bones = [tuple(bone) for bone in skeleton.bones]
    radii = [BONE_RADIUS] * len(bones)
    if torso is not None:
        for shoulder, hip in zip(*torso):
            bones.append((shoulder, hip))
            radii.append(TRUNK_RADIUS)
    return np.array(bones, np.int64).reshape(-1, 2), np.array(radii)


def hidden_marks(found: PersonCandidates, bones: tuple[Array, Array], cams: CameraPoses, rows: int) -> Array:
    """Return the occlusion (D, J) of 2D joints, from the first estimate of the people; see `hidden_joints`.

    Args:
        bones: See `body_bones`.
        rows: D, number of 2D poses.
    """
    places = np.where(np.isfinite(found.guide.positions), found.guide.positions, found.places)
    hidden = hidden_joints(places, found.guide.shifts, found.member >= 0, *bones, cams)
    kinds: Array = hidden_observations(hidden, found.member, found.source, rows)
    return kinds


@njit(cache=True, error_model="numpy")
def hidden_joints(positions, shifts, asked, bones, radii, cams):
    """Return the occlusion (P, V, J) of joints by bones of any person, seen from each view.

    0 = visible or not asked, 1 = perhaps hidden, 2 = hidden.

    Args:
        positions: (P, J, 3) m, world, NaN = unknown. Unknown joints are not hidden, and their bones hide
            nothing.
        shifts: (P, J, 3) m/s, velocities.
        asked: (P, V) whether the joints of the person count in the view.
        bones: (B, 2) joints at the ends.
        radii: (B,) m.
        cams: `CameraPoses`.
    """
    people, joints = positions.shape[:2]
    views = len(cams.rotations)
    hidden = np.zeros((people, views, joints), np.int64)
    places, boxes = np.empty((people, 3, joints)), np.empty((people, 6))
    thickest = RIM * radii.max() if len(radii) else 0.0
    for v in range(views):
        for p in range(people):
            _project(positions[p], shifts[p], cams, v, places[p], boxes[p])
        for q in range(people):
            left, right, top, bottom, near, _ = boxes[q]
            reach = thickest / near
            for p in range(people):
                apart = _apart(boxes[p], left - reach, right + reach, top - reach, bottom + reach, near)
                if asked[p, v] and not apart:
                    _hide(places[p], boxes[p], places[q], p == q, bones, radii, hidden[p, v])
    return hidden


@njit(cache=True, error_model="numpy")
def _project(position, shift, cams, v, place, box):
    """Project the joints of a person into view v.

    Args:
        position: (J, 3) m, world.
        shift: (J, 3) m/s, velocities.
        place: (3, J), output: x, y on the plane and depth m; 0 for joints that are unknown or behind the
            camera.
        box: (6,), output: smallest and largest x, y and depth.
    """
    left = top = near = np.inf
    right = bottom = far = -np.inf
    for j in range(len(position)):
        x, y, z = seen_at(cams, v, position[j], shift[j], cams.delays[v])
        if z <= MIN_DEPTH:
            place[0, j] = place[1, j] = place[2, j] = 0.0
            continue
        place[0, j], place[1, j], place[2, j] = x, y, z
        left, right = min(left, x), max(right, x)
        top, bottom = min(top, y), max(bottom, y)
        near, far = min(near, z), max(far, z)
    box[0], box[1], box[2], box[3], box[4], box[5] = left, right, top, bottom, near, far


@njit(cache=True, error_model="numpy")
def _apart(box, left, right, top, bottom, near):
    """Return whether no joint of a box can be hidden: all are outside of these borders, or not behind `near`.

    The conditions are combined without short circuit, so that the processor predicts one branch.
    """
    return (box[0] > right) | (box[1] < left) | (box[2] > bottom) | (box[3] < top) | (box[5] < near + AHEAD)


@njit(cache=True, error_model="numpy")
def _hide(joints, box, body, own, bones, radii, hidden):
    """Enter into `hidden` which joints in a box lie behind the bones of a body.

    The loop over joints has no branch, so that the compiler treats several joints at once.

    Args:
        joints, body: (3, J), see `_project`.
        box: (6,) of the joints, see `_project`.
        own: Whether the joints belong to the body.
        hidden: (J,) occlusion of the joints, updated.
    """
    factor = OWN_FACTOR if own else 1.0
    xs, ys, depths = joints[0], joints[1], joints[2]
    for b in range(len(bones)):
        start, end = bones[b, 0], bones[b, 1]
        x, y, z = body[0, start], body[1, start], body[2, start]
        if z <= 0.0 or body[2, end] <= 0.0:
            continue
        du, dw, dz = body[0, end] - x, body[1, end] - y, body[2, end] - z
        nearest = min(z, body[2, end])
        reach = RIM * radii[b] / nearest
        left, right = min(x, body[0, end]) - reach, max(x, body[0, end]) + reach
        top, bottom = min(y, body[1, end]) - reach, max(y, body[1, end]) + reach
        if _apart(box, left, right, top, bottom, nearest):
            continue
        of_start, of_end = hidden[start], hidden[end]
        length = max(du * du + dw * dw, 1e-12)
        radius = factor * radii[b]
        for j in range(len(xs)):
            share = min(1.0, max(0.0, ((xs[j] - x) * du + (ys[j] - y) * dw) / length))
            depth = z + share * dz
            gap = (xs[j] - x - share * du) ** 2 + (ys[j] - y - share * dw) ** 2
            gap *= (depth / radius) ** 2
            kind = np.int64(gap < RIM * RIM) + np.int64(gap < CORE * CORE)
            hidden[j] = max(hidden[j], kind if depths[j] >= depth + AHEAD else 0)
        if own:
            hidden[start], hidden[end] = of_start, of_end


@njit(cache=True, error_model="numpy")
def hidden_observations(hidden, member, source, rows):
    """Return the occlusion (D, J) of 2D joints, D = `rows`.

    Args:
        hidden: (P, V, J), see `hidden_joints`.
        member: (P, V) row of the person's 2D pose in each view, -1 = none.
        source: (P, V, J) joint of that 2D pose that stands for joint j.
    """
    people, views, joints = hidden.shape
    result = np.zeros((rows, joints), np.int64)
    for p in range(people):
        for v in range(views):
            d = member[p, v]
            if d >= 0:
                for j in range(joints):
                    result[d, source[p, v, j]] = hidden[p, v, j]
    return result
