"""Compiled kernel of the exact search: eq. 1 at the eight voxels of each of the last boxes."""
from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import inlined, njit
from panoptic_ros.voting.lanes import COVERED, LANES, SIZE, place, score, see, strides
from panoptic_ros.voting.pyramid_kernels import GROUP


@njit(cache=True, error_model="numpy", nogil=True)
def visit(scene, boxes, volume, wanted):
    """All voxels of boxes of level 1 with votes above the threshold that `wanted.min_views` support.

    Args:
        scene: `BoxScene`; boxes: `Boxes`; volume: `Volume`; wanted: `Demands`.

    Returns:
        found (N, 6) joints, voxels, supporting views, 1 for the first voxel of the most votes in its box;
        votes (N,), those of `kernels.vote_points`.
    """
    places, start, lists = boxes
    lanes, sums, support = np.zeros(SIZE), np.zeros((GROUP, LANES)), np.zeros((GROUP, LANES), np.int64)
    mine, covering, total = np.zeros(GROUP, np.int64), np.zeros(LANES), 0
    found, votes = np.zeros((1024, 6), np.int64), np.zeros(1024)
    (x0, y0, z0), side = volume.lower, volume.side
    for n in range(len(places)):
        count = 0
        for joint in range(scene.people.shape[1]):
            mine[count] = joint
            count += places[n, 3] >> joint & 1
        sums[:count], support[:count], covering[:] = 0.0, 0, places[n, 4]
        i, j, k = 2 * places[n, 0] + x0, 2 * places[n, 1] + y0, 2 * places[n, 2] + z0
        for c in range(LANES):
            a, b, d = i + (c >> 2), j + (c >> 1 & 1), k + (c & 1)
            place(lanes, c, (a + 0.5) * side, (b + 0.5) * side, (d + 0.5) * side)
        for at in range(start[n], start[n + 1]):
            v, some = lists[at, 0], lists[at, 1]
            see(scene.cameras, scene.limits, v, lanes)
            for c in range(LANES):
                covering[c] += lanes[COVERED + c]
            for m in range(count):
                if some >> mine[m] & 1:
                    _add(scene, v, mine[m], wanted.view_threshold, lanes, sums[m], support[m])
        if total + LANES * GROUP > len(votes):
            found = np.concatenate((found, np.zeros_like(found)))
            votes = np.concatenate((votes, np.zeros_like(votes)))
        for m in range(count):
            best = total
            for c in range(LANES):
                vote = sums[m, c] / covering[c] if covering[c] > 0.0 else 0.0
                a, b, d = i + (c >> 2), j + (c >> 1 & 1), k + (c & 1)
                inside = a < volume.upper[0] and b < volume.upper[1] and d < volume.upper[2]
                if inside and vote > wanted.threshold and support[m, c] >= wanted.min_views:
                    found[total, 0], found[total, 4], votes[total] = mine[m], support[m, c], vote
                    found[total, 1], found[total, 2], found[total, 3], found[total, 5] = a, b, d, 0
                    best = total if vote > votes[best] else best
                    total += 1
            found[best, 5] = 1
    return found[:total], votes[:total]


@inlined
def _add(scene, v, joint, view_threshold, lanes, sums, support):
    """Add what a view shows of a joint at the points to the sums (8,), and whether that supports them."""
    around = strides(scene.cameras[v])
    for c in range(LANES):
        value = score(scene, v, joint, around, lanes, c) * lanes[COVERED + c]
        sums[c] += value
        support[c] += value > view_threshold
