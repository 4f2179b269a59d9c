"""Compiled kernel of the exact search: an octree of boxes, down to those of 2 x 2 x 2 voxels."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.voting.lanes import COVERED, LANES, SIZE, place, score, see, strides

Array = np.ndarray
MARGIN = 1e-9  # m, more than rounding can do

_jit = njit(cache=True, error_model="numpy", nogil=True)


class _Tree(NamedTuple):
    """Cones (L, N) of the box at hand and of those around it, by level, and how many (L,)."""

    lists: Array
    counts: Array


class _Votes(NamedTuple):
    """Of each joint: the last view that counted (J,); sums (J, 8) and supporting views (J, 8) of voxels.

    possible: (J,) views that may support a place in a box.
    covering: (8,) views that see each voxel. lanes: see there.
    """

    last: Array
    possible: Array
    sums: Array
    support: Array
    covering: Array
    lanes: Array


@_jit
def visit(scene, cones, volume, wanted):
    """All voxels with votes above the threshold that `wanted.min_views` support.

    A box of level L has 2^(L + 1) voxels a side. It keeps those of the cones of the box around it that touch
    the ball about its voxels, of joints that enough views may support; if none is left, it is skipped.

    Args:
        scene: `VoteScene`; cones: `Cones`; volume: `Volume`; wanted: `Demands`.

    Returns:
        found (N, 6): joint, voxel, supporting views, vote as of `kernels.vote_points`.
    """
    joints, ((x0, y0, z0), (x1, y1, z1), side) = scene.map_start.shape[1], volume
    top = 0
    while max(max(x1 - x0, y1 - y0), z1 - z0) > 2 << top:
        top += 1
    tree = _Tree(np.empty((top + 2, len(cones.views)), np.int64), np.zeros(top + 2, np.int64))
    for n in range(len(cones.views)):
        tree.lists[top + 1, n] = n
    tree.counts[top + 1] = len(cones.views)
    votes = _Votes(
        np.zeros(joints, np.int64), np.zeros(joints, np.int64), np.zeros((joints, LANES)),
        np.zeros((joints, LANES), np.int64), np.zeros(LANES), np.zeros(SIZE),
    )  # fmt: skip
    found, total, code, level = np.empty((1024, 6)), 0, 0, top
    while code < 1 << 3 * top:  # Morton codes of the smallest boxes
        i, j, k = x0, y0, z0
        for bit in range(top):
            i += (code >> (3 * bit + 2) & 1) << (bit + 1)
            j += (code >> (3 * bit + 1) & 1) << (bit + 1)
            k += (code >> (3 * bit) & 1) << (bit + 1)
        inside = i < x1 and j < y1 and k < z1
        if inside and _keep(scene, cones, tree, level, (i, j, k, side), wanted, votes):
            if level > 0:
                level -= 1
                continue
            if total + LANES * joints > len(found):
                found = _longer(found, total, LANES * joints)
            _vote(scene, cones, tree, (i, j, k, side), wanted, votes)
            for m in range(joints):
                for c in range(LANES if votes.last[m] >= 0 else 0):
                    vote = votes.sums[m, c] / max(votes.covering[c], 1.0)
                    a, b, d = i + (c >> 2), j + (c >> 1 & 1), k + (c & 1)
                    good = vote > wanted.threshold and votes.support[m, c] >= wanted.min_views
                    if good and a < x1 and b < y1 and d < z1:
                        found[total, 0], found[total, 1], found[total, 2], found[total, 3] = m, a, b, d
                        found[total, 4], found[total, 5] = votes.support[m, c], vote
                        total += 1
        code += 1 << 3 * level
        while level < top and code >> 3 * level & 7 == 0:
            level += 1
    return found[:total]


@_jit
def _keep(scene, cones, tree, level, box, wanted, votes):
    """How many cones a box keeps; box: its first voxel, and the side of a voxel, m."""
    lists, counts, last, possible = tree.lists, tree.counts, votes.last, votes.possible
    half = float(1 << level)
    x, y, z = (box[0] + half) * box[3], (box[1] + half) * box[3], (box[2] + half) * box[3]
    radius = math.sqrt(3.0) * (half - 0.5) * box[3] + MARGIN
    for m in range(len(last)):
        last[m], possible[m] = -1, 0
    touching, view, dx, dy, dz, tangent = 0, -1, 0.0, 0.0, 0.0, 0.0
    for at in range(counts[level + 1]):
        n = lists[level + 1, at]
        v, m = cones.views[n], cones.joints[n]
        if v != view:
            view = v
            dx, dy, dz = x - scene.cameras[v].ox, y - scene.cameras[v].oy, z - scene.cameras[v].oz
            tangent = math.sqrt(max(dx * dx + dy * dy + dz * dz - radius * radius, 0.0))
        along = dx * cones.axes[n, 0] + dy * cones.axes[n, 1] + dz * cones.axes[n, 2]
        near = along >= cones.cosines[n] * tangent - cones.sines[n] * radius
        if near or tangent == 0.0 or cones.cosines[n] < -1.0:  # 0: the view is within the ball
            lists[level, touching] = n
            touching += 1
            if last[m] != v and (cones.supports[n] or wanted.min_views == 0):
                last[m] = v
                possible[m] += 1
    kept = 0
    for at in range(touching):
        n = lists[level, at]
        if possible[cones.joints[n]] >= max(wanted.min_views, 1):
            lists[level, kept] = n
            kept += 1
    counts[level] = kept
    return kept


@_jit
def _vote(scene, cones, tree, box, wanted, votes):
    """Eq. 1 at the voxels of one of the smallest boxes: sums, covering and support."""
    last, _, sums, support, covering, lanes = votes
    for m in range(len(last)):
        last[m] = -1
    covering[:] = 0.0
    for c in range(LANES):
        i, j, k = box[0] + (c >> 2), box[1] + (c >> 1 & 1), box[2] + (c & 1)
        place(lanes, c, (i + 0.5) * box[3], (j + 0.5) * box[3], (k + 0.5) * box[3])
    view = -1
    for at in range(tree.counts[0]):
        v, m = cones.views[tree.lists[0, at]], cones.joints[tree.lists[0, at]]
        if last[m] < 0:
            sums[m], support[m] = 0.0, 0
        elif last[m] == v:
            continue
        last[m] = v
        if v != view:
            see(scene.cameras, scene.limits, v, lanes)
            view = v
        around = strides(scene.cameras[v])
        for c in range(LANES):
            if lanes[COVERED + c] > 0.0:
                value = score(scene, v, m, around, lanes, c)
                sums[m, c] += value
                support[m, c] += value > wanted.view_threshold
    best = 0.0
    for m in range(len(last)):
        for c in range(LANES if last[m] >= 0 else 0):
            if support[m, c] >= wanted.min_views:
                best = max(best, sums[m, c])
    for v in range(len(scene.cameras)):
        least = covering[0]
        for c in range(LANES):
            least = min(least, covering[c])
        if least * wanted.threshold > best or best == 0.0:  # no vote can be above it any more
            break
        see(scene.cameras, scene.limits, v, lanes)
        for c in range(LANES):
            covering[c] += lanes[COVERED + c]


@_jit
def _longer(found, total, more):
    """The same rows with room for twice as many and some more."""
    longer = np.empty((2 * len(found) + more, found.shape[1]))
    for n in range(total):
        for column in range(found.shape[1]):
            longer[n, column] = found[n, column]
    return longer
