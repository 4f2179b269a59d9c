"""Compiled kernels of the exact search: an octree of boxes, down to those of 2 x 2 x 2 voxels.

A vote is above the threshold t if and only if the sum of h_c - t over the views that see the voxel is above
0. For a box, with m_c >= h_c everywhere in it, this sum is at most that of m_c - t over the views that see
all of it, plus that of max(0, m_c - t) over the views that see a part of it. Boxes are those of the
centres of their voxels.

The eight halves of a box are handled side by side, and so are its 32 joints: loops over them have no
branches, so that compilers make vector instructions of them.
"""
from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from panoptic_ros.kernels import inlined, njit
from panoptic_ros.voting.lanes import GAUSSIAN_END
from panoptic_ros.voting.limit_kernels import hide
from panoptic_ros.voting.pyramid_kernels import GROUP
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
    Box,
    rectangles,
)

Array = np.ndarray
SLACK = 1e-3  # of a bound per view, in units of map values: more than float32 can lose
LOW = (1 << GROUP) - 1
SOME, SIGHT, CELL, RIGHT, BELOW = range(5)  # mask of what is there, what is seen, cells of a pyramid


class Boxes(NamedTuple):
    """Boxes of a level.

    places: (N, 5) place, in boxes of their level from the lower corner of the volume; mask of joints; how
        many views see all of the box and have nothing there.
    start, lists: (N + 1) and (K, 2) int32 the other views that see something of each box, and masks of the
        joints of which they have something there.
    """

    places: Array
    start: Array
    lists: Array


class _Scratch(NamedTuple):
    """What is found of the eight halves of a box.

    lanes: see `rectangles`. table: (V, 5, 8) SOME to BELOW of each view. drawn: (8, 32) sums of what
    keypoints show; sums: (32,) of all. planes: (9, 8) binary digits of counts, what overflows, what is
    carried. digits: how many digits. limit: the threshold as a value of a map.
    """

    lanes: Array
    table: Array
    drawn: Array
    sums: Array
    planes: Array
    digits: int
    limit: float


@njit(cache=True, error_model="numpy", nogil=True)
def split(scene, boxes, level, volume, wanted):
    """The halves of boxes that may hold votes above the threshold with enough supporting views.

    Args:
        scene: `BoxScene`; boxes: `Boxes`; volume: `Volume`; wanted: `Demands`.
        level: that of the halves, of 2^level voxels a side, 1 or more.
    """
    places, start, lists = boxes
    count, total, free = len(scene.cameras), 0, 0
    digits = 1
    while wanted.min_views >> digits and digits < 7:
        digits += 1
    limit = 255.0 * wanted.threshold * (1.0 - 1e-6)
    scratch = _Scratch(
        np.zeros((10, 8)), np.zeros((count, 5, 8), np.int64), np.zeros((8, GROUP), np.float32),
        np.zeros(GROUP, np.float32), np.zeros((9, 8), np.int64), digits, limit,
    )  # fmt: skip
    found, begin = np.zeros((8 * len(places), 5), np.int64), np.zeros(8 * len(places) + 1, np.int64)
    kept = np.empty((8 * start[len(places)] + count, 2), np.int32)
    (x0, y0, z0), (x1, y1, z1), side = volume
    step, half = side * (1 << (level - 1)), side * ((1 << (level - 1)) - 0.5)
    for n in range(len(places)):
        mask, listed = places[n, 3], start[n + 1] - start[n]
        i, j, k = 2 * places[n, 0] + 1, 2 * places[n, 1] + 1, 2 * places[n, 2] + 1
        x, y, z = (x0 + (i << level)) * side, (y0 + (j << level)) * side, (z0 + (k << level)) * side
        _look_at_halves(scene, lists[start[n] : start[n + 1], 0], mask, Box(x, y, z, step, half), scratch)
        for c in range(8):
            a, b, d = i - 1 + (c >> 2), j - 1 + (c >> 1 & 1), k - 1 + (c & 1)
            if x0 + (a << level) >= x1 or y0 + (b << level) >= y1 or z0 + (d << level) >= z1:
                continue
            left = mask & _at_least(scratch, c, wanted.min_views)
            if left == 0:
                continue
            whole = places[n, 4] + _sum(scene.pyramids.spread, listed, c, left, scratch)
            left &= _above(scratch.sums, limit * whole - SLACK * (count + 1))
            if left == 0:
                continue
            found[total, 0], found[total, 1], found[total, 2], found[total, 3] = a, b, d, left
            found[total, 4] = places[n, 4]
            for m in range(listed):
                sees, some = scratch.table[m, SIGHT, c], scratch.table[m, SOME, c] & left
                kept[free, 0], kept[free, 1] = lists[start[n] + m, 0], some
                found[total, 4] += (sees == ALL) & (some == 0)
                free += (sees == PART) | (some != 0)
            total += 1
            begin[total] = free
    return Boxes(found[:total], begin[: total + 1], kept)


@inlined
def _look_at_halves(scene, views, mask, box, scratch):
    """Fill the table, the sums of keypoints and the counts for a box whose joints are those of a mask."""
    drawn, planes, table = scratch.drawn, scratch.planes, scratch.table
    drawn[:], planes[:] = 0.0, 0
    for m in range(len(views)):
        v = views[m]
        layer = rectangles(scene, v, box, scratch.lanes)
        if scene.limits[3 * v] > 0.0:
            hide(scene, v, box, scratch.lanes)
        _find(scene.pyramids, v, layer, scratch, m)
        for c in range(8):
            table[m, SOME, c] &= mask | mask << GROUP
        if scene.pointed[v] & mask:
            for c in range(8):
                if scratch.lanes[SEES, c] > 0.0:
                    table[m, SOME, c] |= _add_keypoints(scene, v, scene.pointed[v] & mask, c, scratch)
        _count(scratch, m)


@inlined
def _find(pyramids, v, layer, scratch, m):
    """Write row m of the table: what is in the rectangles of the halves, and where they are in the pyramid.

    Looks in a layer or, where a rectangle spans few cells there, in the one below it.
    """
    layers, masks, lanes, table = pyramids.layers, pyramids.masks, scratch.lanes, scratch.table
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


@inlined
def _sum(spread, listed, c, left, scratch):
    """Set the sums to the largest values in a half over its views; returns how many see all of it."""
    table, drawn, sums = scratch.table, scratch.drawn, scratch.sums
    whole = 0
    for j in range(GROUP):
        sums[j] = drawn[c, j]
    for m in range(listed):
        sees = table[m, SIGHT, c]
        whole += sees == ALL
        if table[m, SOME, c] & left:
            less = 0.0 if sees == ALL else scratch.limit
            _look(spread, table[m, CELL, c], table[m, RIGHT, c], table[m, BELOW, c], less, sums)
    return whole


@inlined
def _count(scratch, m):
    """Add the support in row m of the table to the counts of each joint."""
    table, planes = scratch.table, scratch.planes
    for c in range(8):
        planes[8, c] = table[m, SOME, c] >> GROUP & LOW
    for digit in range(scratch.digits):
        for c in range(8):
            carry = planes[digit, c] & planes[8, c]
            planes[digit, c] ^= planes[8, c]
            planes[8, c] = carry
    for c in range(8):
        planes[7, c] |= planes[8, c]


@inlined
def _at_least(scratch, c, least):
    """Mask of the joints that have been counted at least so often in half c."""
    planes = scratch.planes
    more, same = planes[7, c], -1
    for back in range(scratch.digits):
        digit = scratch.digits - 1 - back
        if least >> digit & 1:
            same &= planes[digit, c]
        else:
            more |= same & planes[digit, c]
            same &= ~planes[digit, c]
    return more | same


@inlined
def _above(sums, bound):
    """Mask of the sums (32,) that are above a bound."""
    mask = 0
    for j in range(GROUP):
        mask |= np.int64(sums[j] > bound) << j
    return mask


@inlined
def _look(spread, at, right, below, less, sums):
    """Add the largest values of joints in a rectangle, as far as above `less`, to the sums (32,).

    The rectangle is that of four cells of `spread`: one, and those so many cells to the right and below.
    """
    low, zero = np.float32(less), np.float32(0.0)
    for j in range(GROUP):
        upper = max(spread[at, j], spread[at + right, j])
        lower = max(spread[at + below, j], spread[at + below + right, j])
        sums[j] += max(np.float32(max(upper, lower)) - low, zero)


@inlined
def _add_keypoints(scene, v, wanted, c, scratch):
    """As `_look`, for keypoints of the joints of a mask in the pixels of half c.

    Returns masks as those of a pyramid.
    """
    people, reach, lanes = scene.people, scene.reach, scratch.lanes
    u0, u1, w0, w1 = lanes[U0, c], lanes[U1, c], lanes[W0, c], lanes[W1, c]
    less = 0.0 if lanes[SEES, c] == ALL else scratch.limit
    found = 0
    for j in range(people.shape[1]):
        value = 0
        for i in range(people.shape[2] if wanted >> j & 1 else 0):
            near_u = u1 >= reach[v, i, 0] and u0 <= reach[v, i, 1]
            if near_u and w1 >= reach[v, i, 2] and w0 <= reach[v, i, 3]:
                u, w = people[v, j, i, 0], people[v, j, i, 1]
                dx, dy = u - min(max(u, u0), u1), w - min(max(w, w0), w1)  # NaN if it is missing
                exponent = (dx * dx + dy * dy) * people[v, j, i, 2]
                if exponent < GAUSSIAN_END:
                    value = max(value, min(int(255.0 * people[v, j, i, 3] * math.exp(-exponent)) + 1, 255))
        if value > 0:
            found |= 1 << j | np.int64(value >= scene.supporting) << (GROUP + j)
            scratch.drawn[c, j] += np.float32(max(value - less, 0.0))
    return found
