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

from panoptic_ros.kernels import njit
from panoptic_ros.voting.limit_kernels import hide
from panoptic_ros.voting.rectangle_kernels import (
    ALL,
    PART,
    SEES,
    SPAN,
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
GROUP = 32  # joints of a search
LOW = (1 << GROUP) - 1
SOME, SIGHT, CELL, RIGHT, BELOW = range(5)  # mask of what is there, what is seen, cells of a pyramid

_jit = njit(cache=True, error_model="numpy", nogil=True)
_inline = njit(cache=True, error_model="numpy", nogil=True, forceinline=True)


@_jit
def split(scene, boxes, start, lists, level, lower, shape, side, threshold, supporting, least):
    """The halves of boxes that may hold votes above the threshold with `least` supporting views.

    Args:
        scene: `BoxScene`; lower, shape (3,): first voxel and numbers of voxels.
        boxes: (N, 5) place, in boxes of their level from `lower`; mask of joints; how many views see all of
            the box and have nothing there.
        start, lists: (N + 1) and (K, 2) int32 the other views that see something of each box, and masks
            of the joints of which they have something there.
        level: that of the halves, of 2^level voxels a side, 1 or more.
        supporting: smallest value of a map that supports.

    Returns:
        boxes, start and lists of the halves.
    """
    views, layers, spread, masks, people, reach, pointed, _, _, limits, limit_layers, limit_reach = scene
    count, total, free = people.shape[0], 0, 0
    lanes, table = np.zeros((10, 8)), np.zeros((count, 5, 8), np.int64)  # of views and halves: SOME to BELOW
    drawn, sums = np.zeros((8, GROUP), np.float32), np.zeros(GROUP, np.float32)  # of keypoints, of all
    planes = np.zeros((9, 8), np.int64)  # binary digits of counts, what overflows, what is carried
    digits = 1
    while least >> digits and digits < 7:
        digits += 1
    found, begin = np.zeros((8 * len(boxes), 5), np.int64), np.zeros(8 * len(boxes) + 1, np.int64)
    kept = np.empty((8 * start[len(boxes)] + count, 2), np.int32)
    limit = 255.0 * threshold * (1.0 - 1e-6)
    step, h = side * (1 << (level - 1)), side * ((1 << (level - 1)) - 0.5)
    for n in range(len(boxes)):
        mask, listed = boxes[n, 3], start[n + 1] - start[n]
        drawn[:], planes[:] = 0.0, 0
        i, j, k = 2 * boxes[n, 0] + 1, 2 * boxes[n, 1] + 1, 2 * boxes[n, 2] + 1
        x, y = (lower[0] + (i << level)) * side, (lower[1] + (j << level)) * side
        z = (lower[2] + (k << level)) * side
        for m in range(listed):
            v = lists[start[n] + m, 0]
            layer = rectangles(views, v, x, y, z, step, h, lanes)
            if limits[3 * v] > 0.0:
                hide(views, limits, limit_layers, limit_reach, v, x, y, z, step, h, lanes)
            _find(layers, masks, v, layer, lanes, table, m)
            for c in range(8):
                table[m, SOME, c] &= mask | mask << GROUP
            if pointed[v] & mask:
                _point(people, reach, v, pointed[v] & mask, lanes, limit, supporting, drawn, table, m)
            _count(planes, digits, table, m)
        for c in range(8):
            a, b, d = i - 1 + (c >> 2), j - 1 + (c >> 1 & 1), k - 1 + (c & 1)
            if (a << level) >= shape[0] or (b << level) >= shape[1] or (d << level) >= shape[2]:
                continue
            left = mask & _at_least(planes, c, digits, least)
            if left == 0:
                continue
            whole = boxes[n, 4] + _sum(spread, table, listed, c, left, limit, drawn, sums)
            left &= _above(sums, limit * whole - SLACK * (count + 1))
            if left == 0:
                continue
            found[total, 0], found[total, 1], found[total, 2], found[total, 3] = a, b, d, left
            found[total, 4], free = _keep(lists, start[n], listed, table, c, left, boxes[n, 4], kept, free)
            total += 1
            begin[total] = free
    return found[:total], begin[: total + 1], kept


@_inline
def _find(layers, masks, v, layer, lanes, table, m):
    """Write row m of the table: what is in the rectangles of the halves, and where they are in the pyramid.

    Looks in a layer or, where a rectangle spans few cells there, in the one below it.
    """
    nothing = len(masks) - 1
    finer = max(layer - 1, 0)
    scale, step = 0.5**finer, layer - finer
    first, width = layers[v, finer, 0], layers[v, finer, 1]
    coarse_first, coarse_width = layers[v, layer, 0], layers[v, layer, 1]
    for c in range(8):
        x0, x1 = np.int64(scale * lanes[X0, c]), np.int64(scale * lanes[X1, c])
        y0, y1 = np.int64(scale * lanes[Y0, c]), np.int64(scale * lanes[Y1, c])
        fits = (x1 - x0 <= SPAN) & (y1 - y0 <= SPAN)
        shift = 0 if fits else step
        x0, x1, y0, y1 = x0 >> shift, x1 >> shift, y0 >> shift, y1 >> shift
        wide = width if fits else coarse_width
        cell = (first if fits else coarse_first) + y0 * wide + x0
        there = (lanes[SEES, c] > 0.0) & (width > 0)
        table[m, CELL, c] = cell if there else nothing
        table[m, RIGHT, c] = max(x1 - x0 - 1, 0) if there else 0
        table[m, BELOW, c] = max(y1 - y0 - 1, 0) * wide if there else 0
        table[m, SIGHT, c] = np.int64(lanes[SEES, c])
    for c in range(8):
        at, right, below = table[m, CELL, c], table[m, RIGHT, c], table[m, BELOW, c]
        table[m, SOME, c] = masks[at] | masks[at + right] | masks[at + below] | masks[at + below + right]


@_inline
def _point(people, reach, v, wanted, lanes, limit, supporting, drawn, table, m):
    """Add what keypoints of a view show in the halves to row m of the table and to their sums (8, 32)."""
    for c in range(8):
        if lanes[SEES, c] > 0.0:
            less = 0.0 if lanes[SEES, c] == ALL else limit
            table[m, SOME, c] |= _add_keypoints(
                people, reach, v, wanted, lanes[U0, c], lanes[U1, c], lanes[W0, c], lanes[W1, c],
                less, supporting, drawn, c,
            )  # fmt: skip


@_inline
def _sum(spread, table, listed, c, left, limit, drawn, sums):
    """Set the sums (32,) to the largest values in a half over its views; returns how many see all of it."""
    whole = 0
    for j in range(GROUP):
        sums[j] = drawn[c, j]
    for m in range(listed):
        sees = table[m, SIGHT, c]
        whole += sees == ALL
        if table[m, SOME, c] & left:
            less = 0.0 if sees == ALL else limit
            _look(spread, table[m, CELL, c], table[m, RIGHT, c], table[m, BELOW, c], less, sums)
    return whole


@_inline
def _keep(lists, first, listed, table, c, left, free_views, kept, free):
    """Write the views that see something of a half.

    Returns how many see all of it and have nothing there, and where to go on.
    """
    for m in range(listed):
        sees, some = table[m, SIGHT, c], table[m, SOME, c] & left
        kept[free, 0], kept[free, 1] = lists[first + m, 0], some
        free_views += (sees == ALL) & (some == 0)
        free += (sees == PART) | (some != 0)
    return free_views, free


@_inline
def _count(planes, digits, table, m):
    """Add the support in row m of the table to the counts of each joint, planes (9, 8) of binary digits."""
    for c in range(8):
        planes[8, c] = table[m, SOME, c] >> GROUP & LOW
    for digit in range(digits):
        for c in range(8):
            carry = planes[digit, c] & planes[8, c]
            planes[digit, c] ^= planes[8, c]
            planes[8, c] = carry
    for c in range(8):
        planes[7, c] |= planes[8, c]


@_inline
def _at_least(planes, c, digits, least):
    """Mask of the bits that have been counted at least so often, with so many digits."""
    more, same = planes[7, c], -1
    for back in range(digits):
        digit = digits - 1 - back
        if least >> digit & 1:
            same &= planes[digit, c]
        else:
            more |= same & planes[digit, c]
            same &= ~planes[digit, c]
    return more | same


@_inline
def _above(sums, bound):
    """Mask of the sums (32,) that are above a bound."""
    mask = 0
    for j in range(GROUP):
        mask |= np.int64(sums[j] > bound) << j
    return mask


@_inline
def _look(spread, at, right, below, less, sums):
    """Add the largest values of joints in a rectangle, as far as above `less`, to the sums (32,).

    The rectangle is that of four cells of `spread`: one, and those so many cells to the right and below.
    """
    low, zero = np.float32(less), np.float32(0.0)
    for j in range(GROUP):
        upper = max(spread[at, j], spread[at + right, j])
        lower = max(spread[at + below, j], spread[at + below + right, j])
        sums[j] += max(np.float32(max(upper, lower)) - low, zero)


@_inline
def _add_keypoints(people, reach, v, wanted, u0, u1, w0, w1, less, enough, sums, c):
    """As `_look`, for keypoints of the joints of a mask in pixels u0..u1, w0..w1; sums (8, 32) of all boxes.

    Returns masks as those of a pyramid.
    """
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
            found |= 1 << j | np.int64(value >= enough) << (GROUP + j)
            sums[c, j] += np.float32(max(value - less, 0.0))
    return found


@_inline
def _exponent(people, v, j, i, u0, u1, w0, w1):
    """Of the Gaussian of a joint where it is highest in a rectangle; NaN if it is missing."""
    u, w = people[v, j, i, 0], people[v, j, i, 1]
    dx, dy = u - min(max(u, u0), u1), w - min(max(w, w0), w1)
    return (dx * dx + dy * dy) * people[v, j, i, 2]
