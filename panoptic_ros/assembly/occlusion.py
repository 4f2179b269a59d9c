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
    hidden = hidden_joints(places, found.guide.shifts, found.member >= 0, *bones, cams)
    kinds: Array = hidden_observations(hidden, found.member, found.source, rows)
    return kinds


@njit(cache=True, error_model="numpy")
def hidden_joints(positions, shifts, asked, bones, radii, cams):
    """Return whether joints lie behind a bone of anybody, seen from each view (P, V, J).

    0 = visible or not asked, 1 = perhaps hidden, 2 = hidden.

    Args:
        positions: (P, J, 3) m, NaN = unknown: such joints are not hidden, their bones hide nothing.
        shifts: (P, J, 3) m/s, velocities. asked: (P, V) the people whose joints count, in each view.
        bones: (B, 2); radii: (B,) m. cams: `Cameras`.
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
    """Write where view v sees the joints of a person into place (3, J): x, y on the plane, depth in m.

    The depth is 0 where the joint is nowhere.

    Args:
        box: (6,) smallest and largest x, y and depth.
    """
    left = top = near = np.inf
    right = bottom = far = -np.inf
    for j in range(len(position)):
        x, y, z = seen_at(cams, v, position[j], shift[j])
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
    """Whether all joints in a box lie beside these borders, or not behind this depth; one branch to guess."""
    return (box[0] > right) | (box[1] < left) | (box[2] > bottom) | (box[3] < top) | (box[5] < near + AHEAD)


@njit(cache=True, error_model="numpy")
def _hide(joints, box, body, own, bones, radii, hidden):
    """Mark joints (3, J) in a box that lie behind the bones of a body (3, J) in hidden (J,), in place.

    The loop over joints has no branch, so that the compiler treats several joints at once.

    Args:
        own: whether the joints belong to that body. For the arrays see `_project`.
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
