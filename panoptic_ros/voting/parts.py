"""Part proposals: pairs of nodes that may form a bone, and how well 2D poses connect them (5.2)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.kernels import inlined, njit
from panoptic_ros.voting.scene import VoteScene
from panoptic_ros.voting.votes import (
    BELOW,
    CELL,
    COVERED,
    LANES,
    RIGHT,
    SIZE,
    U,
    W,
    gaussian,
    place,
    see,
    strides,
)

Array = np.ndarray


class Parts(NamedTuple):
    """Scored parts.

    Args:
        nodes: (M, 2) node indices of the ends.
        bones: (M,) index into `SkeletonModel.bones`.
        scores: (M,) connectivity scores.
    """

    nodes: Array
    bones: Array
    scores: Array


NO_PARTS = Parts(np.zeros((0, 2), np.int64), np.zeros(0, np.int64), np.zeros(0))


def score_parts(
    scene: VoteScene,
    nodes: Array,
    joints: Array,
    bones: tuple[tuple[int, int], ...],
    longest: float,
    threshold: float,
) -> Parts:
    """Return parts between nodes (N, 3) m of the joints (N,), with their connectivity scores.

    The score Phi is the mean of max_i (h_iu + h_iv) / 2 over the views that see both ends. The index i runs
    over the 2D poses of the view. A term is 0 unless both scores are above the threshold. Parts with score 0
    are dropped.

    Args:
        bones: Parent and child joint of each bone, as in `SkeletonModel`.
        longest: m, greatest length of a part.
        threshold: Least score of both ends in a view.
    """
    joints = np.ascontiguousarray(joints, np.int64)
    parts, which = _near_pairs(nodes, joints, np.array(bones, np.int64).reshape(-1, 2), longest)
    scores, seen = person_scores(scene, joints, nodes)
    phi = connectivity(scores, seen, parts, threshold)
    connected = phi > 0.0
    return Parts(parts[connected], which[connected], phi[connected])


@njit(cache=True, error_model="numpy", nogil=True)
def _near_pairs(nodes, joints, bones, longest):
    """Return pairs (M, 2) of nodes that a bone (K, 2) may join, sorted by bone, and their bones (M,)."""
    pairs, which, count = np.zeros((256, 2), np.int64), np.zeros(256, np.int64), 0
    for k in range(len(bones)):
        for a in range(len(nodes)):
            for b in range(len(nodes) if joints[a] == bones[k, 0] else 0):
                x, y, z = nodes[a, 0] - nodes[b, 0], nodes[a, 1] - nodes[b, 1], nodes[a, 2] - nodes[b, 2]
                if joints[b] != bones[k, 1] or x * x + y * y + z * z > longest * longest:
                    continue
                if count == len(which):
                    pairs = np.concatenate((pairs, np.zeros_like(pairs)))
                    which = np.concatenate((which, np.zeros_like(which)))
                pairs[count, 0], pairs[count, 1], which[count] = a, b, k
                count += 1
    return pairs[:count], which[:count]


@njit(cache=True, error_model="numpy", nogil=True)
def person_scores(scene, joints, points):
    """Return scores h_ij (N, V, P) of points (N, 3) for the joints (N,), and which views see them (N, V)."""
    views, most = len(scene.cameras), scene.people.shape[2]
    scores, seen = np.zeros((len(points), views, most)), np.zeros((len(points), views), np.bool_)
    corners, lanes = np.zeros((most + 1, 4)), np.zeros(SIZE)
    for first in range(0, len(points), LANES):
        count = min(LANES, len(points) - first)
        for c in range(count):
            place(lanes, c, points[first + c, 0], points[first + c, 1], points[first + c, 2])
        for v in range(views):
            see(scene.cameras, scene.limits, v, lanes)
            for c in range(count):
                n, j = first + c, joints[first + c]
                seen[n, v] = lanes[COVERED + c] > 0.0
                if seen[n, v] and scene.map_start[v, j] < 0:
                    for i in range(most):
                        scores[n, v, i] = gaussian(scene.people, v, j, i, lanes[U + c], lanes[W + c])
                elif seen[n, v] and _look_at_patches(scene, v, j, lanes, c, corners):
                    for i in range(most):
                        scores[n, v, i] = _score_of_person(scene, v, j, i, lanes, c, corners)
    return scores, seen


@inlined
def _look_at_patches(scene, v, j, lanes, c, corners):
    """Write the patch values of the four cells round point c to corners (P + 1, 4): per person, then merged.

    Returns:
        whether any patch has one of these cells.
    """
    table, key = scene.patch_table, v * scene.map_start.shape[1] + j
    columns, (right, below) = int(scene.cameras[v].columns), strides(scene.cameras[v])
    x0, y0 = int(lanes[CELL + c]) % columns, int(lanes[CELL + c]) // columns
    corners[:] = 0.0
    some = False
    for k in range(scene.patch_start[key], scene.patch_start[key + 1]):
        person, width, height = table[k, 0], table[k, 3], table[k, 4]
        for corner in range(4):
            x = x0 + (right if corner & 1 else 0) - table[k, 1]
            y = y0 + (1 if corner & 2 and below > 0 else 0) - table[k, 2]
            if 0 <= x < width and 0 <= y < height:
                value = float(scene.patch_data[table[k, 5] + y * width + x])
                corners[person, corner] = max(corners[person, corner], value)  # person -1 (merged): last row
                some = True
    return some


@inlined
def _score_of_person(scene, v, j, i, lanes, c, corners):
    """Return h_ij at point c. Merged maps count for a person whose joint is within the gate."""
    dx, dy = scene.people[v, j, i, 0] - lanes[U + c], scene.people[v, j, i, 1] - lanes[W + c]
    also = len(corners) - 1 if dx * dx + dy * dy <= scene.gates[v, i] else i
    x, y = lanes[RIGHT + c], lanes[BELOW + c]
    a, b = max(corners[i, 0], corners[also, 0]), max(corners[i, 1], corners[also, 1])
    p, q = max(corners[i, 2], corners[also, 2]), max(corners[i, 3], corners[also, 3])
    return ((a * (1.0 - x) + b * x) * (1.0 - y) + (p * (1.0 - x) + q * x) * y) / 255.0


@njit(cache=True, error_model="numpy", nogil=True)
def connectivity(scores, seen, parts, threshold):
    """Return the scores (M,) of parts (M, 2).

    Args:
        scores: (N, V, P) h_ij, see `score_parts`.
        seen: (N, V) which views see each node.
    """
    result = np.zeros(len(parts))
    _, views, people = scores.shape
    for m in range(len(parts)):
        a, b = parts[m, 0], parts[m, 1]
        total, seeing = 0.0, 0
        for v in range(views):
            if not (seen[a, v] and seen[b, v]):
                continue
            seeing += 1
            best = 0.0
            for i in range(people):
                if scores[a, v, i] > threshold and scores[b, v, i] > threshold:
                    best = max(best, 0.5 * (scores[a, v, i] + scores[b, v, i]))
            total += best
        if seeing:
            result[m] = total / seeing
    return result
