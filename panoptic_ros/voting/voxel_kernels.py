"""Compiled kernels of the exact search: eq. 1 at the voxels of boxes.

They call nothing outside of this file.
"""
from __future__ import annotations

import math

import numpy as np
from numba import njit

from panoptic_ros.voting.score_field import GAUSSIAN_END

MIN_DEPTH = 1e-3  # m, as in the pinhole camera of `geometry`
GROUP = 32  # joints of a search

_jit = njit(cache=True, error_model="numpy", nogil=True)
_inline = njit(cache=True, error_model="numpy", nogil=True, forceinline=True)


@_jit
def visit(scene, boxes, start, lists, lower, shape, side, threshold, view_threshold, least):
    """All voxels of the boxes with votes above the threshold that at least `least` views support.

    Args:
        scene: `BoxScene`; boxes, start, lists: of `box_kernels.split`, level 1.

    Returns:
        found (N, 5) joints, voxels, supporting views; votes (N,), those of `kernels.vote`.
    """
    views, layers, values, bits, people, _, pointed = scene
    table, looks = np.zeros((len(views), 6), np.int64), np.zeros((len(views), 4))
    found, votes, total = np.zeros((1024, 5), np.int64), np.zeros(1024), 0
    for n in range(len(boxes)):
        if total + 8 * GROUP > len(votes):
            found = np.concatenate((found, np.zeros_like(found)))
            votes = np.concatenate((votes, np.zeros_like(votes)))
        for child in range(8):
            i, j = 2 * boxes[n, 0] + (child >> 2), 2 * boxes[n, 1] + (child >> 1 & 1)
            k = 2 * boxes[n, 2] + (child & 1)
            if i < shape[0] and j < shape[1] and k < shape[2]:
                total = _visit(
                    views, layers, values, bits, people, pointed, i + lower[0], j + lower[1], k + lower[2],
                    side, threshold, view_threshold, least, lists, start[n],
                    start[n + 1], boxes[n, 3], boxes[n, 4], table, looks, found, votes, total,
                )  # fmt: skip
    return found[:total], votes[:total]


@_inline
def _visit(
    views, layers, values, bits, people, pointed, i, j, k, side,
    threshold, view_threshold, least, lists, begin, end, mask, empty,
    table, looks, found, votes, total,
):  # fmt: skip
    """Eq. 1 at a voxel for the joints of a mask, as `kernels.vote` does it; appends what is good enough."""
    joints = people.shape[1]
    x, y, z = (i + 0.5) * side, (j + 0.5) * side, (k + 0.5) * side
    covering, count, ones, twos, threes = empty, 0, 0, 0, 0
    for n in range(begin, end):
        v = lists[n]
        if not _look(views, layers, v, x, y, z, looks, table, count):
            continue
        covering += 1
        some, much = 0, 0
        if views[v, 25] > 0.0:
            every = (
                bits[table[count, 0]] | bits[table[count, 1]] | bits[table[count, 2]] | bits[table[count, 3]]
            )
            some, much = every, every >> GROUP
        if pointed[v] & mask:
            more, most = _pointed(people, v, joints, pointed[v] & mask, looks[count, 2], looks[count, 3])
            some, much = some | more, much | most
        some, much = some & mask, much & mask
        if some == 0:
            continue
        table[count, 4], table[count, 5] = some, v
        count += 1
        threes |= twos & much
        twos |= ones & much
        ones |= much
    if least >= 1:
        mask &= ones if least == 1 else twos if least == 2 else threes
    for joint in range(joints):
        if mask >> joint & 1:
            vote, support = _sum(values, people, pointed, joint, count, table, looks, view_threshold)
            vote = vote / covering if covering else 0.0
            if vote > threshold and support >= least:
                found[total, 0], found[total, 4], votes[total] = joint, support, vote
                found[total, 1], found[total, 2], found[total, 3] = i, j, k
                total += 1
    return total


@_inline
def _pointed(people, v, joints, wanted, u, w):
    """Joints of a mask that a keypoint of view v gives anything at a pixel, and enough to support."""
    some, much = 0, 0
    for p in range(people.shape[2]):
        for j in range(joints):
            if wanted >> j & 1:
                dx, dy = people[v, j, p, 0] - u, people[v, j, p, 1] - w
                exponent = (dx * dx + dy * dy) * people[v, j, p, 2]
                if exponent < GAUSSIAN_END:
                    some |= 1 << j
                if exponent < people[v, j, p, 4]:
                    much |= 1 << j
    return some, much


@_inline
def _sum(values, people, pointed, joint, count, table, looks, view_threshold):
    """Sum of the scores of a joint in the views looked at, in order, and how many support it."""
    total, support = 0.0, 0
    for n in range(count):
        if not table[n, 4] >> joint & 1:
            continue
        v = table[n, 5]
        score = 0.0
        if pointed[v] >> joint & 1:
            for p in range(people.shape[2]):
                dx, dy = people[v, joint, p, 0] - looks[n, 2], people[v, joint, p, 1] - looks[n, 3]
                exponent = (dx * dx + dy * dy) * people[v, joint, p, 2]
                if exponent < GAUSSIAN_END:
                    score = max(score, people[v, joint, p, 3] * math.exp(-exponent))
        else:
            fx, fy = looks[n, 0], looks[n, 1]
            top = values[table[n, 0], joint] * (1.0 - fx) + values[table[n, 1], joint] * fx
            bottom = values[table[n, 2], joint] * (1.0 - fx) + values[table[n, 3], joint] * fx
            score = (top * (1.0 - fy) + bottom * fy) / 255.0
        total += score
        support += score > view_threshold
    return total, support


@_inline
def _look(views, layers, v, x, y, z, looks, table, n):
    """Whether view v covers a point; weights and pixel, four cells. Step by step as in `kernels`."""
    covered = False
    depth = views[v, 6] * x + views[v, 7] * y + views[v, 8] * z + views[v, 11]
    if depth > MIN_DEPTH:
        px = (views[v, 0] * x + views[v, 1] * y + views[v, 2] * z + views[v, 9]) / depth
        py = (views[v, 3] * x + views[v, 4] * y + views[v, 5] * z + views[v, 10]) / depth
        r2 = px * px + py * py
        if views[v, 35] > 0.0:
            covered = r2 < views[v, 22]
            p1, p2 = views[v, 19], views[v, 20]
            radial = 1.0 + r2 * (views[v, 17] + r2 * (views[v, 18] + r2 * views[v, 21]))
            dx = px * radial + 2.0 * p1 * px * py + p2 * (r2 + 2.0 * px * px)
            dy = py * radial + p1 * (r2 + 2.0 * py * py) + 2.0 * p2 * px * py
            px, py = dx, dy
        else:
            covered = True
        u = views[v, 12] * px + views[v, 13] * py + views[v, 14]
        w = views[v, 15] * py + views[v, 16]
        covered &= -0.5 <= u <= views[v, 23] - 0.5 and -0.5 <= w <= views[v, 24] - 0.5
        looks[n, 2], looks[n, 3] = u, w
        if covered and views[v, 25] > 0.0:
            a = views[v, 27] * u + views[v, 28] * w + views[v, 29]
            b = views[v, 30] * u + views[v, 31] * w + views[v, 32]
            covered = -0.5 <= a <= views[v, 25] - 0.5 and -0.5 <= b <= views[v, 26] - 0.5
            x0, x1, looks[n, 0] = _corner(a, views[v, 25])
            y0, y1, looks[n, 1] = _corner(b, views[v, 26])
            start, width = layers[v, 0, 0], layers[v, 0, 1]
            table[n, 0], table[n, 1] = start + y0 * width + x0, start + y0 * width + x1
            table[n, 2], table[n, 3] = start + y1 * width + x0, start + y1 * width + x1
    return covered


@_inline
def _corner(at, size):
    """Lower and upper cell, and the upper one's weight, for a bilinear sample clamped to the grid."""
    at = min(max(at, 0.0), size - 1.0)
    low = min(int(at), max(int(size) - 2, 0))
    return low, min(low + 1, int(size) - 1), at - low
