"""Compiled kernels of the exact search: an octree of boxes, down to those of 2 x 2 x 2 voxels.

A vote is above the threshold t if and only if the sum of h_c - t over the views that see the voxel is above
0. For a box, with m_c >= h_c everywhere in it, this sum is at most that of m_c - t over the views that see
all of it, plus that of max(0, m_c - t) over the views that see a part of it. Boxes are those of the
centres of their voxels.

They call nothing outside of this file. Arrays as in `BoxScene`. Locked reference counts would cost more
than all the rest, so inner functions take arrays one by one, return at one place only, and use no array for
the last time within a branch.
"""
from __future__ import annotations

import math

import numpy as np
from numba import njit

from panoptic_ros.voting.lens_bounds import BINS
from panoptic_ros.voting.score_field import GAUSSIAN_END

BEND = 38  # column of the first lens bound in `views`
MIN_DEPTH = 1e-3  # m, as in the pinhole camera of `geometry`
TINY = 1e-9
FAR = 1e9  # half the side of a rectangle that is not bounded, in the plane at 1 m
MARGIN = 1e-3  # px, more than rounding can do
SPAN = 3  # cells that a rectangle spans in the layer it is looked up in, less one
FULL = 65280  # a score of 1 in bounds, which are whole numbers: 256 times that of a map
GROUP = 32  # joints of a search
MASK = (1 << GROUP) - 1
NONE, PART, ALL = 0, 1, 2  # of a box that a view sees

_jit = njit(cache=True, error_model="numpy", nogil=True)
_inline = njit(cache=True, error_model="numpy", nogil=True, forceinline=True)


@_inline
def view_box(views, v, x, y, z, h):
    """What view v sees of a box: centre x, y, z and half side h.

    Returns NONE, PART or ALL, and the pixels u0, u1, w0, w1 within which all of it is that can be seen.
    """
    sees, u, w, wu, ww = NONE, 0.0, 0.0, FAR, FAR
    depth = views[v, 6] * x + views[v, 7] * y + views[v, 8] * z + views[v, 11]
    reach = h * views[v, 34]
    cx = views[v, 0] * x + views[v, 1] * y + views[v, 2] * z + views[v, 9]
    cy = views[v, 3] * x + views[v, 4] * y + views[v, 5] * z + views[v, 10]
    if depth - reach > MIN_DEPTH + TINY:
        near = 1.0 / (depth * (depth - reach))  # one division for two
        px, py, scale = cx * (depth - reach) * near, cy * (depth - reach) * near, h * depth * near
        wx, wy = scale * _lean(views, v, 0, px), scale * _lean(views, v, 3, py)
        sees = ALL
        if views[v, 35] > 0.0:
            sees, px, py, wx, wy = _bend(views, v, px, py, wx, wy)
        u = views[v, 12] * px + views[v, 13] * py + views[v, 14]
        w = views[v, 15] * py + views[v, 16]
        wu = views[v, 12] * wx + abs(views[v, 13]) * wy + MARGIN
        ww = views[v, 15] * wy + MARGIN
    elif depth + reach > MIN_DEPTH - TINY:  # across the plane of the camera: anywhere, or far beside
        far = depth + reach + TINY
        beside_x = abs(cx) - h * _lean(views, v, 0, 0.0) - TINY
        beside_y = abs(cy) - h * _lean(views, v, 3, 0.0) - TINY
        sees = NONE if (beside_x > views[v, 36] * far) | (beside_y > views[v, 37] * far) else PART
    u0, u1, w0, w1 = -0.5, views[v, 23] - 0.5, -0.5, views[v, 24] - 0.5
    outside = (u + wu < u0) | (u - wu > u1) | (w + ww < w0) | (w - ww > w1)
    across = (u - wu < u0) | (u + wu > u1) | (w - ww < w0) | (w + ww > w1)
    sees = min(sees, NONE if outside else PART if across else ALL)
    return sees, max(u - wu, u0), min(u + wu, u1), max(w - ww, w0), min(w + ww, w1)


@_inline
def _lean(views, v, at, slope):
    """How fast X - slope * Z (at 0) or Y - slope * Z (at 3) changes at most, per half side of a box."""
    r20, r21, r22 = views[v, 6], views[v, 7], views[v, 8]
    x, y, z = views[v, at] - slope * r20, views[v, at + 1] - slope * r21, views[v, at + 2] - slope * r22
    return abs(x) + abs(y) + abs(z)


@_inline
def _bend(views, v, px, py, wx, wy):
    """The distorted middle and half sides of a rectangle of the image plane, infinite if not bounded."""
    fold, end = views[v, 22], views[v, 35]
    left, top = max(abs(px) - wx, 0.0), max(abs(py) - wy, 0.0)
    r2, far2 = px * px + py * py, (abs(px) + wx) ** 2 + (abs(py) + wy) ** 2
    beyond = left * left + top * top >= fold * (1.0 + TINY)
    sees = NONE if beyond else ALL if far2 < fold * (1.0 - TINY) else PART
    # farther out than the end points are bounded only if they are beyond the fold, too, and not seen
    bounded = (far2 < end * end * (1.0 - TINY)) | (end * end >= fold * (1.0 - TINY))
    if bounded & (r2 < end * end * (1.0 - TINY)):
        at = BEND + 2 * min(int(math.sqrt(far2) / end * BINS), BINS - 1)
        p1, p2 = views[v, 19], views[v, 20]
        radial = 1.0 + r2 * (views[v, 17] + r2 * (views[v, 18] + r2 * views[v, 21]))
        dx = px * radial + 2.0 * p1 * px * py + p2 * (r2 + 2.0 * px * px)
        dy = py * radial + p1 * (r2 + 2.0 * py * py) + 2.0 * p2 * px * py
        own, other = views[v, at], views[v, at + 1]
        px, py, wx, wy = dx, dy, own * wx + other * wy, other * wx + own * wy
    else:
        sees, px, py, wx, wy = min(sees, PART), 0.0, 0.0, FAR, FAR
    return sees, px, py, wx, wy


@_inline
def map_rectangle(views, layers, v, sees, u0, u1, w0, w1, table, n):
    """Where to look in the pyramid of view v: layer, columns and rows, last ones included.

    Returns what the view sees of it, borders of the map considered.
    """
    u, wu, w, ww = 0.5 * (u0 + u1), 0.5 * (u1 - u0), 0.5 * (w0 + w1), 0.5 * (w1 - w0)
    a = views[v, 27] * u + views[v, 28] * w + views[v, 29]
    b = views[v, 30] * u + views[v, 31] * w + views[v, 32]
    wa = abs(views[v, 27]) * wu + abs(views[v, 28]) * ww + TINY
    wb = abs(views[v, 30]) * wu + abs(views[v, 31]) * ww + TINY
    right, below = views[v, 25] - 0.5, views[v, 26] - 0.5
    outside = (a + wa < -0.5) | (a - wa > right) | (b + wb < -0.5) | (b - wb > below)
    across = (a - wa < -0.5) | (a + wa > right) | (b - wb < -0.5) | (b + wb > below)
    sees = min(sees, NONE if outside else PART if across else ALL)
    x0, x1 = int(max(a - wa, 0.0)), int(min(max(a + wa, 0.0) + 1.0, views[v, 25] - 1.0))
    y0, y1 = int(max(b - wb, 0.0)), int(min(max(b + wb, 0.0) + 1.0, views[v, 26] - 1.0))
    x0, y0 = min(x0, x1), min(y0, y1)
    layer = 0
    while x1 - x0 > SPAN or y1 - y0 > SPAN:
        x0, x1, y0, y1 = x0 >> 1, x1 >> 1, y0 >> 1, y1 >> 1
        layer += 1
    width = layers[v, layer, 1]
    table[n, 0] = layers[v, layer, 0] + y0 * width + x0
    table[n, 1], table[n, 2], table[n, 3] = x1 - x0 + 1, y1 - y0 + 1, width
    return sees


@_inline
def rectangle_bits(bits, table, n):
    """Joints with anything in a rectangle, and with enough to support, up to four cells in a row."""
    most, every = table[n, 1] - 1, np.int64(0)
    for y in range(table[n, 2]):
        at = table[n, 0] + y * table[n, 3]
        every |= bits[at] | bits[at + min(1, most)] | bits[at + min(2, most)] | bits[at + most]
    return every & MASK, every >> GROUP & MASK


@_inline
def rectangle_maximum(values, table, n, j):
    """Largest value of a joint in a rectangle."""
    most, best = table[n, 1] - 1, np.int64(0)
    for y in range(table[n, 2]):
        at = table[n, 0] + y * table[n, 3]
        left = max(np.int64(values[at, j]), np.int64(values[at + min(1, most), j]))
        right = max(np.int64(values[at + min(2, most), j]), np.int64(values[at + most, j]))
        best = max(best, left, right)
    return best


@_inline
def keypoint_bits(people, reach, v, joints, wanted, u0, u1, w0, w1):
    """As `rectangle_bits`, for the keypoints of one view in pixels u0..u1, w0..w1, joints of a mask."""
    some, much = 0, 0
    for i in range(reach.shape[1]):
        if u1 < reach[v, i, 0] or u0 > reach[v, i, 1] or w1 < reach[v, i, 2] or w0 > reach[v, i, 3]:
            continue
        for j in range(joints):
            if wanted >> j & 1:
                exponent = _exponent(people, v, j, i, u0, u1, w0, w1)
                if exponent < GAUSSIAN_END:
                    some |= 1 << j
                if exponent < people[v, j, i, 4]:
                    much |= 1 << j
    return some, much


@_inline
def keypoint_maximum(people, v, j, u0, u1, w0, w1):
    """The most that keypoints of a joint reach in pixels u0..u1, w0..w1."""
    best = 0
    for i in range(people.shape[2]):
        exponent = _exponent(people, v, j, i, u0, u1, w0, w1)
        if exponent < GAUSSIAN_END:
            best = max(best, int(people[v, j, i, 3] * math.exp(-exponent) * FULL) + 1)
    return best


@_inline
def _exponent(people, v, j, i, u0, u1, w0, w1):
    """Of the Gaussian of a joint where it is highest in a rectangle; NaN if it is missing."""
    u, w = people[v, j, i, 0], people[v, j, i, 1]
    dx, dy = u - min(max(u, u0), u1), w - min(max(w, w0), w1)
    return (dx * dx + dy * dy) * people[v, j, i, 2]


@_jit
def split(scene, boxes, start, lists, level, lower, shape, side, threshold, least):
    """The halves of boxes that may hold votes above the threshold with `least` supporting views.

    Args:
        scene: `BoxScene`; lower, shape (3,): first voxel and numbers of voxels.
        boxes: (N, 5) place, in boxes of their level from `lower`; mask of joints; how many views see all of
            the box and have nothing there.
        start, lists: (N + 1) and (K,) the other views that see something of each box.
        level: that of the halves, of 2^level voxels a side, 1 or more.

    Returns:
        boxes, start and lists of the halves.
    """
    views, layers, values, bits, people, reach, pointed = scene
    count, total = people.shape[0], 0
    table, looks, sums = np.zeros((count, 6), np.int64), np.zeros((count, 4)), np.zeros((2, GROUP), np.int64)
    size = 8 * len(boxes)
    found, begin = np.zeros((size, 5), np.int64), np.zeros(size + 1, np.int64)
    kept = np.zeros(8 * len(lists) + count, np.int32)
    for n in range(len(boxes)):
        for child in range(8):
            i, j = 2 * boxes[n, 0] + (child >> 2), 2 * boxes[n, 1] + (child >> 1 & 1)
            k = 2 * boxes[n, 2] + (child & 1)
            if i << level < shape[0] and j << level < shape[1] and k << level < shape[2]:
                found[total, 0], found[total, 1], found[total, 2] = i, j, k
                total += _admit(
                    views, layers, values, bits, people, reach, pointed, found, begin, kept, total, level,
                    lower, side, threshold, least, lists, start[n], start[n + 1], boxes[n, 3], boxes[n, 4],
                    table, looks, sums,
                )  # fmt: skip
    return found[:total], begin[: total + 1], kept


@_inline
def _admit(
    views, layers, values, bits, people, reach, pointed, found, begin, kept, at, level, lower,
    side, threshold, least, lists, first, last, mask, empty, table, looks, sums,
):  # fmt: skip
    """Whether a box, whose place is in row `at` of `found`, may hold anything; if so completes the row."""
    half, joints, free = 1 << (level - 1), people.shape[1], begin[at]
    x = (lower[0] + (found[at, 0] << level) + half) * side
    y = (lower[1] + (found[at, 1] << level) + half) * side
    z = (lower[2] + (found[at, 2] << level) + half) * side
    h = side * (half - 0.5) * (1.0 + TINY) + TINY
    count, ones, twos, threes = 0, 0, 0, 0
    for k in range(first, last):
        v = lists[k]
        sees, u0, u1, w0, w1 = view_box(views, v, x, y, z, h)
        if sees == NONE:
            continue
        some, much = 0, 0
        if views[v, 25] > 0.0:
            sees = map_rectangle(views, layers, v, sees, u0, u1, w0, w1, table, count)
            if sees == NONE:
                continue
            some, much = rectangle_bits(bits, table, count)
        if pointed[v] & mask:
            more, most = keypoint_bits(people, reach, v, joints, pointed[v] & mask, u0, u1, w0, w1)
            some, much = some | more, much | most
        some, much = some & mask, much & mask
        if some == 0 and sees == ALL:
            empty += 1
            continue
        table[count, 4], table[count, 5] = sees, some
        looks[count, 0], looks[count, 1], looks[count, 2], looks[count, 3] = u0, u1, w0, w1
        kept[free + count] = v
        count += 1
        threes |= twos & much
        twos |= ones & much
        ones |= much
    if least >= 1:
        mask &= ones if least == 1 else twos if least == 2 else threes
    mask = _bounded(
        views, values, people, pointed, kept, free, count, mask, empty, threshold, table, looks, sums
    )
    found[at, 3], found[at, 4], begin[at + 1] = mask, empty, free + count
    return 1 if mask else 0


@_inline
def _bounded(views, values, people, pointed, kept, free, count, mask, empty, threshold, table, looks, sums):
    """The joints of a mask whose bound is above 0."""
    limit = int(threshold * FULL * (1.0 - TINY)) - 1
    common = -limit * empty
    wanted = 0
    for j in range(people.shape[1]):
        if mask >> j & 1:
            sums[0, wanted], sums[1, wanted] = j, 0
            wanted += 1
    for k in range(count if mask else 0):
        v, less = kept[free + k], limit
        if table[k, 4] == ALL:
            common -= limit
            less = 0
        if table[k, 5] & mask == 0:
            continue
        for n in range(wanted):
            j, most = sums[0, n], np.int64(0)
            if table[k, 5] >> j & 1:
                if pointed[v] >> j & 1:
                    most = keypoint_maximum(people, v, j, looks[k, 0], looks[k, 1], looks[k, 2], looks[k, 3])
                else:
                    most = rectangle_maximum(values, table, k, j) << 8
            sums[1, n] += max(most - less, 0)
    left = 0
    for n in range(wanted):
        if sums[1, n] + common > 0:
            left |= 1 << sums[0, n]
    return left
