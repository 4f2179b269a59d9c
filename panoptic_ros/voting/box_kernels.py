"""Compiled kernels of the exact search: an octree of boxes, down to those of 2 x 2 x 2 voxels.

A vote is above the threshold t if and only if the sum of h_c - t over the views that see the voxel is above
0. For a box, with m_c >= h_c everywhere in it, this sum is at most that of m_c - t over the views that see
all of it, plus that of max(0, m_c - t) over the views that see a part of it. Boxes are those of the
centres of their voxels.

They call nothing outside of this file. Arrays as in `BoxScene`; the inner functions take them one by one,
as every access to a member of a tuple costs a locked reference count.
"""
from __future__ import annotations

import math

import numpy as np
from numba import njit

from panoptic_ros.voting.score_field import GAUSSIAN_END

MIN_DEPTH = 1e-3  # m, as in the pinhole camera of `geometry`
TINY = 1e-9
MARGIN = 1e-3  # px, more than rounding can do
SPAN = 3  # cells that a rectangle spans in the layer it is looked up in, less one
FULL = 65280  # a score of 1 in bounds, which are whole numbers: 256 times that of a map
GROUP = 32  # joints of a search
TOP = 4  # level of the boxes to start with; those of level 0 are voxels
NONE, PART, ALL = 0, 1, 2  # of a box that a view sees

_jit = njit(cache=True, error_model="numpy", nogil=True)
_inline = njit(cache=True, error_model="numpy", nogil=True, forceinline=True)


@_inline
def view_box(views, slopes, v, x, y, z, h):
    """What view v sees of a box: centre x, y, z and half side h.

    Returns NONE, PART or ALL, and the pixels u0, u1, w0, w1 within which all of it is that can be seen.
    """
    depth = views[v, 6] * x + views[v, 7] * y + views[v, 8] * z + views[v, 11]
    reach = h * views[v, 34]
    right, below = views[v, 23] - 0.5, views[v, 24] - 0.5
    if depth + reach <= MIN_DEPTH - TINY:
        return NONE, 0.0, 0.0, 0.0, 0.0
    cx = views[v, 0] * x + views[v, 1] * y + views[v, 2] * z + views[v, 9]
    cy = views[v, 3] * x + views[v, 4] * y + views[v, 5] * z + views[v, 10]
    if depth - reach <= MIN_DEPTH + TINY:  # across the plane of the camera: anywhere, or far beside
        far = depth + reach + TINY
        beside_x = abs(cx) - h * (abs(views[v, 0]) + abs(views[v, 1]) + abs(views[v, 2])) - TINY
        beside_y = abs(cy) - h * (abs(views[v, 3]) + abs(views[v, 4]) + abs(views[v, 5])) - TINY
        if beside_x > views[v, 36] * far or beside_y > views[v, 37] * far:
            return NONE, 0.0, 0.0, 0.0, 0.0
        return PART, -0.5, right, -0.5, below
    px, py = cx / depth, cy / depth
    scale = h / (depth - reach)
    wx = scale * (
        abs(views[v, 0] - px * views[v, 6])
        + abs(views[v, 1] - px * views[v, 7])
        + abs(views[v, 2] - px * views[v, 8])
    )
    wy = scale * (
        abs(views[v, 3] - py * views[v, 6])
        + abs(views[v, 4] - py * views[v, 7])
        + abs(views[v, 5] - py * views[v, 8])
    )
    sees = ALL
    if views[v, 35] > 0.0:
        sees, px, py, wx, wy = _bend(views, slopes, v, px, py, wx, wy)
        if sees == NONE:
            return NONE, 0.0, 0.0, 0.0, 0.0
        if wx == np.inf:
            return PART, -0.5, right, -0.5, below
    u = views[v, 12] * px + views[v, 13] * py + views[v, 14]
    w = views[v, 15] * py + views[v, 16]
    wu = views[v, 12] * wx + abs(views[v, 13]) * wy + MARGIN
    ww = views[v, 15] * wy + MARGIN
    if u + wu < -0.5 or u - wu > right or w + ww < -0.5 or w - ww > below:
        return NONE, 0.0, 0.0, 0.0, 0.0
    if u - wu < -0.5 or u + wu > right or w - ww < -0.5 or w + ww > below:
        sees = PART
    return sees, u - wu, u + wu, w - ww, w + ww


@_inline
def _bend(views, slopes, v, px, py, wx, wy):
    """The distorted middle and half sides of a rectangle of the image plane, infinite if not bounded."""
    fold = views[v, 22]
    left, top = max(abs(px) - wx, 0.0), max(abs(py) - wy, 0.0)
    if left * left + top * top >= fold * (1.0 + TINY):
        return NONE, px, py, wx, wy
    end = views[v, 35]
    r2 = px * px + py * py
    if r2 >= end * end * (1.0 - TINY):
        return PART, px, py, np.inf, np.inf
    far2 = (abs(px) + wx) ** 2 + (abs(py) + wy) ** 2
    at = min(int(math.sqrt(far2) / end * slopes.shape[1]), slopes.shape[1] - 1)
    # points beyond the end are not seen if it is the fold
    sees = ALL if far2 < fold * (1.0 - TINY) else PART
    if end * end < fold * (1.0 - TINY) and far2 >= end * end * (1.0 - TINY):
        return PART, px, py, np.inf, np.inf
    p1, p2 = views[v, 19], views[v, 20]
    radial = 1.0 + r2 * (views[v, 17] + r2 * (views[v, 18] + r2 * views[v, 21]))
    dx = px * radial + 2.0 * p1 * px * py + p2 * (r2 + 2.0 * px * px)
    dy = py * radial + p1 * (r2 + 2.0 * py * py) + 2.0 * p2 * px * py
    own, other = slopes[v, at, 0], slopes[v, at, 1]
    return sees, dx, dy, own * wx + other * wy, other * wx + own * wy


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
    if a + wa < -0.5 or a - wa > right or b + wb < -0.5 or b - wb > below:
        return NONE
    if a - wa < -0.5 or a + wa > right or b - wb < -0.5 or b + wb > below:
        sees = PART
    x0, x1 = int(max(a - wa, 0.0)), min(int(max(a + wa, 0.0)) + 1, int(views[v, 25]) - 1)
    y0, y1 = int(max(b - wb, 0.0)), min(int(max(b + wb, 0.0)) + 1, int(views[v, 26]) - 1)
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
    """Joints with anything in a rectangle, and with enough to support."""
    some, much = 0, 0
    for y in range(table[n, 2]):
        row = table[n, 0] + y * table[n, 3]
        for x in range(table[n, 1]):
            some |= np.int64(bits[row + x, 0])
            much |= np.int64(bits[row + x, 1])
    return some, much


@_inline
def rectangle_maxima(values, table, n, best, sums):
    """The second row of sums (2, 32) becomes the largest values in a rectangle; best (32,) is scratch."""
    best[:] = 0
    for y in range(table[n, 2]):
        row = table[n, 0] + y * table[n, 3]
        for x in range(table[n, 1]):
            for j in range(GROUP):
                best[j] = max(best[j], values[row + x, j])
    for j in range(GROUP):
        sums[1, j] = np.int32(best[j]) << 8


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
def keypoint_maxima(people, reach, v, joints, wanted, u0, u1, w0, w1, sums):
    """Raise the second row of sums to what keypoints of joints of a mask reach in pixels u0..u1, w0..w1."""
    for i in range(reach.shape[1]):
        if u1 < reach[v, i, 0] or u0 > reach[v, i, 1] or w1 < reach[v, i, 2] or w0 > reach[v, i, 3]:
            continue
        for j in range(joints):
            if wanted >> j & 1:
                exponent = _exponent(people, v, j, i, u0, u1, w0, w1)
                if exponent < GAUSSIAN_END:
                    most = int(people[v, j, i, 3] * math.exp(-exponent) * FULL) + 1
                    sums[1, j] = max(sums[1, j], most)


@_inline
def _exponent(people, v, j, i, u0, u1, w0, w1):
    """Of the Gaussian of a joint where it is highest in a rectangle; NaN if it is missing."""
    u, w = people[v, j, i, 0], people[v, j, i, 1]
    dx, dy = u - min(max(u, u0), u1), w - min(max(w, w0), w1)
    return (dx * dx + dy * dy) * people[v, j, i, 2]


@_jit
def search(scene, lower, shape, side, threshold, least):
    """All boxes of 2 x 2 x 2 voxels that may hold votes above the threshold with `least` supporting views.

    Args:
        scene: `BoxScene`; lower, shape (3,): first voxel and numbers of voxels.

    Returns:
        boxes (N, 5): first voxel less `lower`, divided by 2; mask of joints; how many views see all of the
        box and have nothing there; start (N + 1) and lists: the other views that see something of it.
    """
    views, slopes, layers, values, bits, people, reach, pointed = scene
    count, joints = people.shape[0], people.shape[1]
    limit = int(threshold * FULL * (1.0 - TINY)) - 1
    stack, lists = np.zeros((7 * TOP + 8, 7), np.int64), np.zeros((7 * TOP + 8, count), np.int32)
    own = np.arange(count).astype(np.int32)
    table, looks = np.zeros((count, 6), np.int64), np.zeros((count, 4))
    best, sums = np.zeros(GROUP, np.uint8), np.zeros((2, GROUP), np.int32)
    boxes, start, total = np.zeros((256, 5), np.int64), np.zeros(257, np.int64), 0
    kept = np.zeros(256 * count, np.int32)
    roots = (shape + (1 << TOP) - 1) >> TOP
    for root in range(roots[0] * roots[1] * roots[2]):
        # above the first box, as if it had only one child
        x, y, z = root // (roots[1] * roots[2]), root // roots[2] % roots[1], root % roots[2]
        level, length, mask, empty, used, children = TOP, count, (1 << joints) - 1, 0, 0, 1
        for k in range(count):
            own[k] = k
        while True:
            for child in range(children):
                i, j, k = x + (child >> 2), y + (child >> 1 & 1), z + (child & 1)
                if i << level >= shape[0] or j << level >= shape[1] or k << level >= shape[2]:
                    continue
                stack[used, 0], stack[used, 1], stack[used, 2], stack[used, 3] = level, i, j, k
                used += _admit(
                    views, slopes, layers, values, bits, people, reach, pointed, stack, lists, used, lower,
                    side, limit, least, own, length, mask, empty, table, looks, best, sums,
                )  # fmt: skip
            while used and stack[used - 1, 0] == 1:
                used -= 1
                if total == len(boxes) or start[total] + count > len(kept):
                    boxes, start, kept = _longer(boxes, start, kept)
                for n in range(5):
                    boxes[total, n] = stack[used, 1 + n]
                length = stack[used, 6]
                kept[start[total] : start[total] + length] = lists[used, :length]
                total += 1
                start[total] = start[total - 1] + length
            if not used:
                break
            used -= 1
            level, mask, empty, length = stack[used, 0] - 1, stack[used, 4], stack[used, 5], stack[used, 6]
            x, y, z, children = stack[used, 1] << 1, stack[used, 2] << 1, stack[used, 3] << 1, 8
            own[:length] = lists[used, :length]
    return boxes[:total], start[: total + 1], kept


@_jit
def _longer(boxes, start, kept):
    more = np.zeros((2 * len(boxes), boxes.shape[1]), np.int64)
    further, far = np.zeros(2 * len(boxes) + 1, np.int64), np.zeros(2 * len(kept), np.int32)
    more[: len(boxes)], further[: len(start)], far[: len(kept)] = boxes, start, kept
    return more, further, far


@_inline
def _admit(
    views, slopes, layers, values, bits, people, reach, pointed, stack, lists, slot, lower,
    side, limit, least, own, length, mask, empty, table, looks, best, sums,
):  # fmt: skip
    """Whether a box may hold anything; if so its place on the stack is filled.

    That is level and place (given), mask of joints, how many views see all of it with nothing there, and
    how many views in `lists` matter within it, out of `length` views in `own`.
    """
    half, joints = 1 << (stack[slot, 0] - 1), people.shape[1]
    x = (lower[0] + (stack[slot, 1] << stack[slot, 0]) + half) * side
    y = (lower[1] + (stack[slot, 2] << stack[slot, 0]) + half) * side
    z = (lower[2] + (stack[slot, 3] << stack[slot, 0]) + half) * side
    h = side * (half - 0.5) * (1.0 + TINY) + TINY
    count, ones, twos, threes = 0, 0, 0, 0
    for k in range(length):
        v = own[k]
        sees, u0, u1, w0, w1 = view_box(views, slopes, v, x, y, z, h)
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
        lists[slot, count] = v
        count += 1
        threes |= twos & much
        twos |= ones & much
        ones |= much
    if least >= 1:
        mask &= ones if least == 1 else twos if least == 2 else threes
    if mask:
        mask = _bounded(
            views, values, people, reach, pointed, lists, slot, count, mask, -limit * empty, limit,
            table, looks, best, sums,
        )  # fmt: skip
    stack[slot, 4], stack[slot, 5], stack[slot, 6] = mask, empty, count
    return 1 if mask else 0


@_inline
def _bounded(
    views, values, people, reach, pointed, lists, slot, count, mask, common, limit, table, looks, best, sums
):
    """The joints of a mask whose bound is above 0; `common` is what views with nothing there add to it."""
    joints = people.shape[1]
    sums[0] = 0
    for k in range(count):
        v = lists[slot, k]
        if table[k, 4] == ALL:
            common -= limit
        if table[k, 5] & mask == 0:
            continue
        if views[v, 25] > 0.0:
            rectangle_maxima(values, table, k, best, sums)
        else:
            sums[1] = 0
        if pointed[v] & mask:
            u0, u1, w0, w1 = looks[k, 0], looks[k, 1], looks[k, 2], looks[k, 3]
            keypoint_maxima(people, reach, v, joints, pointed[v] & mask, u0, u1, w0, w1, sums)
        less = 0 if table[k, 4] == ALL else limit
        for j in range(GROUP):
            sums[0, j] += max(sums[1, j] - less, 0)
    left = 0
    for j in range(joints):
        if mask >> j & 1 and sums[0, j] + common > 0:
            left |= 1 << j
    return left
