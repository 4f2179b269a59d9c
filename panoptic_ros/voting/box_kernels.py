"""Compiled kernels of the exact search: an octree of boxes, down to those of 2 x 2 x 2 voxels.

A vote is above the threshold t if and only if the sum of h_c - t over the views that see the voxel is above
0. For a box, with m_c >= h_c everywhere in it, this sum is at most that of m_c - t over the views that see
all of it, plus that of max(0, m_c - t) over the views that see a part of it. Boxes are those of the
centres of their voxels.

The eight halves of a box are handled side by side, and so are its 32 joints: loops over them have no
branches, so that compilers make vector instructions of them. Arrays as in `BoxScene`. Locked reference
counts would cost more than all the rest, so inner functions take arrays one by one, return at one place
only, and use no array for the last time within a branch.
"""
from __future__ import annotations

import math

import numpy as np
from numba import njit

from panoptic_ros.voting.rectangle_kernels import (
    ALL,
    GROUP,
    NONE,
    SEES,
    U0,
    U1,
    W0,
    W1,
    X0,
    X1,
    Y0,
    Y1,
    rectangles,
)
from panoptic_ros.voting.score_field import GAUSSIAN_END

SLACK = 1e-3  # of a bound per view, in units of map values: more than float32 can lose
CAP = 200  # views that support are counted up to here

_jit = njit(cache=True, error_model="numpy", nogil=True)
_inline = njit(cache=True, error_model="numpy", nogil=True, forceinline=True)


@_jit
def split(scene, boxes, start, lists, level, lower, shape, side, threshold, supporting, least):
    """The halves of boxes that may hold votes above the threshold with `least` supporting views.

    Args:
        scene: `BoxScene`; lower, shape (3,): first voxel and numbers of voxels.
        boxes: (N, 5) place, in boxes of their level from `lower`; mask of joints; how many views see all of
            the box and have nothing there.
        start, lists: (N + 1) and (K,) the other views that see something of each box.
        level: that of the halves, of 2^level voxels a side, 1 or more.
        supporting: smallest value of a map that supports.

    Returns:
        boxes, start and lists of the halves.
    """
    views, layers, _, spread, people, reach, pointed = scene
    count, joints, total, free = people.shape[0], people.shape[1], 0, 0
    lanes, wanted = np.zeros(80), np.zeros(GROUP, np.uint8)
    most = np.zeros((8, count, GROUP), np.uint8)
    words, wanted_words = most.view(np.int64), wanted.view(np.int64)
    sums, support = np.zeros((8, GROUP), np.float32), np.zeros((8, GROUP), np.uint8)
    enough, least = np.uint8(supporting), min(least, CAP)
    seen, tally = np.zeros((8, count), np.int32), np.zeros((3, 8), np.int64)  # listed, empty, all of it
    found, begin = np.zeros((8 * len(boxes), 5), np.int64), np.zeros(8 * len(boxes) + 1, np.int64)
    kept = np.empty(8 * start[len(boxes)] + count, np.int32)
    half, limit = 1 << (level - 1), 255.0 * threshold * (1.0 - 1e-6)
    for n in range(len(boxes)):
        mask = boxes[n, 3]
        for j in range(GROUP):
            wanted[j] = 255 if mask >> j & 1 else 0
        sums[:], support[:], tally[:] = 0.0, 0, 0
        tally[1] = boxes[n, 4]
        i, j, k = 2 * boxes[n, 0] + 1, 2 * boxes[n, 1] + 1, 2 * boxes[n, 2] + 1
        x, y = (lower[0] + (i << level)) * side, (lower[1] + (j << level)) * side
        z = (lower[2] + (k << level)) * side
        for at in range(start[n], start[n + 1]):
            v = lists[at]
            layer = rectangles(views, v, x, y, z, side * half, side * (half - 0.5), lanes)
            first, width = layers[v, layer, 0], layers[v, layer, 1]
            for c in range(8):
                sees = int(lanes[SEES + c])
                if sees == NONE:
                    continue
                some, less, m = 0, 0.0 if sees == ALL else limit, tally[0, c]
                if width > 0:
                    x0, y0 = int(lanes[X0 + c]) >> layer, int(lanes[Y0 + c]) >> layer
                    x1, y1 = int(lanes[X1 + c]) >> layer, int(lanes[Y1 + c]) >> layer
                    at_cell = first + y0 * width + x0
                    look(
                        spread, at_cell, x1 - x0, y1 - y0, width, wanted, less, enough, most, sums, support,
                        c, m,
                    )  # fmt: skip
                    some = words[c, m, 0] | words[c, m, 1] | words[c, m, 2] | words[c, m, 3]
                else:
                    words[c, m, 0] = words[c, m, 1] = words[c, m, 2] = words[c, m, 3] = 0
                if pointed[v] & mask:
                    u0, u1, w0, w1 = lanes[U0 + c], lanes[U1 + c], lanes[W0 + c], lanes[W1 + c]
                    some |= _add_keypoints(
                        people, reach, v, pointed[v] & mask, u0, u1, w0, w1, less, enough, most, sums,
                        support, c, m,
                    )  # fmt: skip
                if some == 0 and sees == ALL:
                    tally[1, c] += 1
                    continue
                seen[c, m] = v if sees == ALL else -1 - v
                tally[0, c] += 1
                tally[2, c] += sees == ALL
        for c in range(8):
            a, b, d = i - 1 + (c >> 2), j - 1 + (c >> 1 & 1), k - 1 + (c & 1)
            if (a << level) >= shape[0] or (b << level) >= shape[1] or (d << level) >= shape[2]:
                continue
            most_left = limit * (tally[1, c] + tally[2, c]) - SLACK * (count + 1)
            left = 0
            for joint in range(joints):
                if mask >> joint & 1 and sums[c, joint] > most_left and support[c, joint] >= least:
                    left |= 1 << joint
            if left == 0:
                continue
            found[total, 0], found[total, 1], found[total, 2] = a, b, d
            for joint in range(GROUP):
                wanted[joint] = 255 if left >> joint & 1 else 0
            empty = tally[1, c]
            for m in range(tally[0, c]):
                some = words[c, m, 0] & wanted_words[0] | words[c, m, 1] & wanted_words[1]
                some |= words[c, m, 2] & wanted_words[2] | words[c, m, 3] & wanted_words[3]
                v = seen[c, m]
                if v >= 0 and some == 0:
                    empty += 1
                else:
                    kept[free] = v if v >= 0 else -1 - v
                    free += 1
            found[total, 3], found[total, 4] = left, empty
            total += 1
            begin[total] = free
    return found[:total], begin[: total + 1], kept


@_inline
def look(spread, at, columns, rows, width, wanted, less, enough, most, sums, support, c, m):
    """Add the largest values of joints in a rectangle, as far as above `less`, to the sums (8, 32) of box c.

    The rectangle begins at a cell and has so many columns and rows more, three at most: four cells of
    `spread`, each of which stands for 2 x 2. Counts the values that are `enough`, keeps all in row m of
    `most` (8, V, 32); joints that are not wanted (32,) count as 0.
    """
    low, zero, cap = np.float32(less), np.float32(0.0), np.uint8(CAP)
    right, below = max(columns - 1, 0), width * max(rows - 1, 0)
    for j in range(GROUP):
        upper = max(spread[at, j], spread[at + right, j])
        lower = max(spread[at + below, j], spread[at + below + right, j])
        most[c, m, j] = wanted[j] & max(upper, lower)
    for j in range(GROUP):
        sums[c, j] += max(np.float32(most[c, m, j]) - low, zero)
    for j in range(GROUP):
        support[c, j] += np.uint8((most[c, m, j] >= enough) & (support[c, j] < cap))


@_inline
def _add_keypoints(people, reach, v, wanted, u0, u1, w0, w1, less, enough, most, sums, support, c, m):
    """As `look`, for keypoints of the joints of a mask in pixels u0..u1, w0..w1; whether there are any."""
    found = 0
    for j in range(people.shape[1]):
        value = 0
        for i in range(people.shape[2] if wanted >> j & 1 else 0):
            near_u = u1 >= reach[v, i, 0] and u0 <= reach[v, i, 1]
            if near_u and w1 >= reach[v, i, 2] and w0 <= reach[v, i, 3]:
                exponent = _exponent(people, v, j, i, u0, u1, w0, w1)
                if exponent < GAUSSIAN_END:
                    value = max(value, min(int(255.0 * people[v, j, i, 3] * math.exp(-exponent)) + 1, 255))
        if value > 0:
            found, most[c, m, j] = 1, value
            sums[c, j] += np.float32(max(value - less, 0.0))
            support[c, j] = min(support[c, j] + (value >= enough), CAP)
    return found


@_inline
def _exponent(people, v, j, i, u0, u1, w0, w1):
    """Of the Gaussian of a joint where it is highest in a rectangle; NaN if it is missing."""
    u, w = people[v, j, i, 0], people[v, j, i, 1]
    dx, dy = u - min(max(u, u0), u1), w - min(max(w, w0), w1)
    return (dx * dx + dy * dy) * people[v, j, i, 2]
