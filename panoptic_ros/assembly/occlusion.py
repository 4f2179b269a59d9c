"""Which joints are hidden behind a body, as far as the skeletons tell.

Detectors guess hidden joints, with several times the noise of visible ones and often a high score. How
much noisier they are is learnt online (see `noise`); here is only geometry: a body is its bones, thickened.
"""
from __future__ import annotations

import numpy as np
from numba import njit

from panoptic_ros.domain import SkeletonModel

Array = np.ndarray

BONE_RADIUS = 0.05  # m
TRUNK_RADIUS = 0.09  # m, of bones between the trunk's joints
OWN_FACTOR = 0.7  # bones are thinner against joints of their own body
CORE, RIM = 0.8, 1.3  # of a radius: within are hidden joints, those that may be, and the visible
AHEAD = 0.06  # m, by which a bone must be closer to the camera than the joint
MIN_DEPTH = 0.05  # m


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


@njit(cache=True, error_model="numpy")
def hidden_joints(positions, shifts, bones, radii, cams):
    """Whether joints lie behind a bone of anybody, seen from each view.

    0 = visible, 1 = perhaps hidden, 2 = hidden, (P, V, J).

    Args:
        positions: (P, J, 3) m, NaN = unknown: such joints are not hidden, their bones hide nothing.
        shifts: (P, J, 3) m/s, velocities. bones: (B, 2); radii: (B,) m. cams: see `Scene`.
    """
    rotations, translations, delays = cams
    people, joints = positions.shape[:2]
    views, count = len(rotations), len(bones)
    hidden = np.zeros((people, views, joints), np.int64)
    local = np.empty((people, joints, 3))
    box = np.empty((people, 5))
    for v in range(views):
        r = rotations[v]
        for p in range(people):
            box[p, 0] = box[p, 2] = np.inf
            box[p, 1] = box[p, 3] = box[p, 4] = -np.inf
            for j in range(joints):
                a = positions[p, j, 0] + shifts[p, j, 0] * delays[v]
                b = positions[p, j, 1] + shifts[p, j, 1] * delays[v]
                c = positions[p, j, 2] + shifts[p, j, 2] * delays[v]
                z = r[2, 0] * a + r[2, 1] * b + r[2, 2] * c + translations[v, 2]
                if not z > MIN_DEPTH:
                    local[p, j, 2] = 0.0
                    continue
                u = (r[0, 0] * a + r[0, 1] * b + r[0, 2] * c + translations[v, 0]) / z
                w = (r[1, 0] * a + r[1, 1] * b + r[1, 2] * c + translations[v, 1]) / z
                local[p, j, 0], local[p, j, 1], local[p, j, 2] = u, w, z
                box[p, 0], box[p, 1] = min(box[p, 0], u), max(box[p, 1], u)
                box[p, 2], box[p, 3] = min(box[p, 2], w), max(box[p, 3], w)
                box[p, 4] = max(box[p, 4], z)
        for q in range(people):
            for b in range(count):
                first, second = local[q, bones[b, 0]], local[q, bones[b, 1]]
                if first[2] <= 0.0 or second[2] <= 0.0:
                    continue
                nearest = min(first[2], second[2])
                reach = RIM * radii[b] / nearest
                low_u, high_u = min(first[0], second[0]) - reach, max(first[0], second[0]) + reach
                low_w, high_w = min(first[1], second[1]) - reach, max(first[1], second[1]) + reach
                du, dw = second[0] - first[0], second[1] - first[1]
                length = max(du * du + dw * dw, 1e-12)
                for p in range(people):
                    if box[p, 4] < nearest + AHEAD:
                        continue
                    if box[p, 0] > high_u or box[p, 1] < low_u or box[p, 2] > high_w or box[p, 3] < low_w:
                        continue
                    factor = OWN_FACTOR if p == q else 1.0
                    for j in range(joints):
                        x = local[p, j]
                        if x[0] < low_u or x[0] > high_u or x[1] < low_w or x[1] > high_w:
                            continue
                        if x[2] < nearest + AHEAD or hidden[p, v, j] == 2:
                            continue
                        if p == q and (j == bones[b, 0] or j == bones[b, 1]):
                            continue
                        share = ((x[0] - first[0]) * du + (x[1] - first[1]) * dw) / length
                        share = min(1.0, max(0.0, share))
                        depth = first[2] + share * (second[2] - first[2])
                        if x[2] < depth + AHEAD:
                            continue
                        gap = (x[0] - first[0] - share * du) ** 2 + (x[1] - first[1] - share * dw) ** 2
                        gap *= (depth / (factor * radii[b])) ** 2
                        if gap < RIM * RIM:
                            hidden[p, v, j] = 2 if gap < CORE * CORE else 1
    return hidden


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
