"""Which joints are hidden behind a body, as far as the skeletons tell.

Detectors guess hidden joints, with several times the noise of visible ones and often a high score. How
much noisier they are is learnt online (see `noise`); here is only geometry: a body is its bones, thickened.
"""
from __future__ import annotations

import numpy as np

from panoptic_ros.domain import SkeletonModel
from panoptic_ros.kernels import njit
from panoptic_ros.solving.joint_records import Candidates
from panoptic_ros.solving.scene import MIN_DEPTH, Cameras, seen_at

Array = np.ndarray

BONE_RADIUS = 0.05  # m
TRUNK_RADIUS = 0.09  # m, of bones between the trunk's joints
OWN_FACTOR = 0.7  # bones are thinner against joints of their own body
CORE, RIM = 0.8, 1.3  # of a radius: within are hidden joints, those that may be, and the visible
AHEAD = 0.06  # m, by which a bone must be closer to the camera than the joint


def body_bones(skeleton: SkeletonModel, torso: tuple[tuple[int, int], ...] | None) -> tuple[Array, Array]:
    """Bones (B, 2) that hide others, and their radii (B,) m: those of the skeleton, and the flanks.

    Args:
        torso: shoulders and hips, each (left, right), or None if the skeleton has none.
    """
    bones = [tuple(bone) for bone in skeleton.bones]
    radii = [BONE_RADIUS] * len(bones)
    if torso is not None:
        for shoulder, hip in zip(*torso):
            bones.append((shoulder, hip))
            radii.append(TRUNK_RADIUS)
    return np.array(bones, np.int64).reshape(-1, 2), np.array(radii)


def hidden_marks(found: Candidates, bones: tuple[Array, Array], cams: Cameras, rows: int) -> Array:
    """How hidden the joints are that D = `rows` 2D people show, (D, J), by the first estimate of the people.

    Args:
        bones: see `body_bones`.
    """
    places = np.where(np.isfinite(found.guide.positions), found.guide.positions, found.places)
    hidden = hidden_joints(places, found.guide.shifts, *bones, cams)
    kinds: Array = hidden_observations(hidden, found.member, found.source, rows)
    return kinds


@njit(cache=True, error_model="numpy")
def hidden_joints(positions, shifts, bones, radii, cams):
    """Whether joints lie behind a bone of anybody, seen from each view.

    0 = visible, 1 = perhaps hidden, 2 = hidden, (P, V, J).

    Args:
        positions: (P, J, 3) m, NaN = unknown: such joints are not hidden, their bones hide nothing.
        shifts: (P, J, 3) m/s, velocities. bones: (B, 2); radii: (B,) m. cams: `Cameras`.
    """
    people, joints = positions.shape[:2]
    views = len(cams.rotations)
    hidden = np.zeros((people, views, joints), np.int64)
    places, boxes = np.empty((people, joints, 3)), np.empty((people, 6))
    thickest = RIM * radii.max() if len(radii) else 0.0
    for v in range(views):
        for p in range(people):
            _project(positions[p], shifts[p], cams, v, places[p], boxes[p])
        for q in range(people):
            left, right, top, bottom, near, _ = boxes[q]
            reach = thickest / near
            for p in range(people):
                if not _apart(boxes[p], left - reach, right + reach, top - reach, bottom + reach, near):
                    _hide(places[p], boxes[p], places[q], p == q, bones, radii, hidden[p, v])
    return hidden


@njit(cache=True, error_model="numpy")
def _project(position, shift, cams, v, place, box):
    """Places (J, 3) of a person's joints in view v: x, y on the plane, depth in m, 0 = nowhere.

    box: (6,) smallest and largest x, y and depth.
    """
    left = top = near = np.inf
    right = bottom = far = -np.inf
    for j in range(len(position)):
        x, y, z = seen_at(cams, v, position[j], shift[j])
        if z <= MIN_DEPTH:
            place[j, 2] = 0.0
            continue
        place[j, 0], place[j, 1], place[j, 2] = x, y, z
        left, right = min(left, x), max(right, x)
        top, bottom = min(top, y), max(bottom, y)
        near, far = min(near, z), max(far, z)
    box[0], box[1], box[2], box[3], box[4], box[5] = left, right, top, bottom, near, far


@njit(cache=True, error_model="numpy")
def _apart(box, left, right, top, bottom, near):
    """Whether all joints in a box lie beside these borders, or not behind this depth; one branch to guess."""
    return (box[0] > right) | (box[1] < left) | (box[2] > bottom) | (box[3] < top) | (box[5] < near + AHEAD)


@njit(cache=True, error_model="numpy")
def _hide(joints, box, body, own, bones, radii, hidden):
    """Mark joints (J, 3) in a box that lie behind the bones of a body (J, 3) in hidden (J,), in place.

    own: whether the joints belong to that body. For the arrays see `_project`.
    """
    factor = OWN_FACTOR if own else 1.0
    for b in range(len(bones)):
        start, end = bones[b, 0], bones[b, 1]
        x, y, z = body[start, 0], body[start, 1], body[start, 2]
        if z <= 0.0 or body[end, 2] <= 0.0:
            continue
        du, dw, dz = body[end, 0] - x, body[end, 1] - y, body[end, 2] - z
        nearest = min(z, body[end, 2])
        reach = RIM * radii[b] / nearest
        left, right = min(x, body[end, 0]) - reach, max(x, body[end, 0]) + reach
        top, bottom = min(y, body[end, 1]) - reach, max(y, body[end, 1]) + reach
        if _apart(box, left, right, top, bottom, nearest):
            continue
        length = max(du * du + dw * dw, 1e-12)
        for j in range(len(joints)):
            u, w, far = joints[j, 0], joints[j, 1], joints[j, 2]
            beside = (u < left) | (u > right) | (w < top) | (w > bottom)
            if beside | (far < nearest + AHEAD) | (own & ((j == start) | (j == end))):
                continue
            share = min(1.0, max(0.0, ((u - x) * du + (w - y) * dw) / length))
            depth = z + share * dz
            if far < depth + AHEAD:
                continue
            gap = (u - x - share * du) ** 2 + (w - y - share * dw) ** 2
            gap *= (depth / (factor * radii[b])) ** 2
            if gap < RIM * RIM:
                hidden[j] = max(hidden[j], 2 if gap < CORE * CORE else 1)


@njit(cache=True, error_model="numpy")
def hidden_observations(hidden, member, source, rows):
    """The same of 2D joints (D, J), from hidden (P, V, J), member (P, V), source (P, V, J)."""
    people, views, joints = hidden.shape
    result = np.zeros((rows, joints), np.int64)
    for p in range(people):
        for v in range(views):
            d = member[p, v]
            if d >= 0:
                for j in range(joints):
                    result[d, source[p, v, j]] = hidden[p, v, j]
    return result
