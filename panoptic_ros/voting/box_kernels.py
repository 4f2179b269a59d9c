"""Compiled kernels of the exact search: an octree of boxes, down to those of 2 x 2 x 2 voxels.

A vote is above the threshold t if and only if the sum of h_c - t over the views that see the voxel is above
0. For a box, with m_c >= h_c everywhere in it, this sum is at most that of m_c - t over the views that see
all of it, plus that of max(0, m_c - t) over the views that see a part of it. Boxes are those of the
centres of their voxels.

The eight halves of a box are handled side by side, and so are its 32 joints: loops over them have no branches,
so that compilers make vector instructions of them. They call nothing outside of this file. Arrays as in
`BoxScene`. Locked reference counts would cost more than all the rest, so inner functions take arrays one
by one, return at one place only, and use no array for the last time within a branch.
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
CAP = 200  # views that support are counted up to here
SLACK = 1e-3  # of a bound per view, in units of map values: more than float32 can lose
GROUP = 32  # joints of a search
NONE, PART, ALL = 0, 1, 2  # of a box that a view sees
U0, U1, W0, W1, SEES, X0, X1, Y0, Y1, WIDE = range(0, 80, 8)  # in `lanes` (80,): a rectangle per half

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
    views, layers, values, people, reach, pointed = scene
    count, joints, total, free = people.shape[0], people.shape[1], 0, 0
    lanes, wanted = np.zeros(80), np.zeros(GROUP, np.uint8)
    most = np.zeros((8, count, GROUP), np.uint8)
    words, wanted_words = most.view(np.int64), wanted.view(np.int64)
    sums, support = np.zeros((8, GROUP), np.float32), np.zeros((8, GROUP), np.uint8)
    enough, least = np.uint8(supporting), min(least, CAP)
    seen, tally = np.zeros((8, count), np.int32), np.zeros((3, 8), np.int64)  # listed, empty, all of it
    found, begin = np.zeros((8 * len(boxes), 5), np.int64), np.zeros(8 * len(boxes) + 1, np.int64)
    kept = np.zeros(8 * len(lists) + count, np.int32)
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
            layer = _rectangles(views, v, x, y, z, side * half, side * (half - 0.5), lanes)
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
                        values, at_cell, x1 - x0, y1 - y0, width, wanted, less, enough, most, sums, support, c, m
                    )
                    some = words[c, m, 0] | words[c, m, 1] | words[c, m, 2] | words[c, m, 3]
                else:
                    words[c, m, 0] = words[c, m, 1] = words[c, m, 2] = words[c, m, 3] = 0
                if pointed[v] & mask:
                    u0, u1, w0, w1 = lanes[U0 + c], lanes[U1 + c], lanes[W0 + c], lanes[W1 + c]
                    some |= _add_keypoints(
                        people, reach, v, pointed[v] & mask, u0, u1, w0, w1, less, enough, most, sums, support, c, m
                    )
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
def look(values, at, columns, rows, width, wanted, less, enough, most, sums, support, c, m):
    """Add the largest values of joints in a rectangle, as far as above `less`, to the sums (8, 32) of box c.

    The rectangle begins at a cell and has so many columns and rows more, three at most. Counts the values
    that are `enough`, keeps all in row m of `most` (8, V, 32); those of joints that are not wanted (32,) count as 0.
    """
    low, zero, cap = np.float32(less), np.float32(0.0), np.uint8(CAP)
    p, q, r = min(1, columns), min(2, columns), columns
    b, d, e = at + width * min(1, rows), at + width * min(2, rows), at + width * rows
    for j in range(GROUP):
        upper = max(
            max(max(values[at, j], values[at + p, j]), max(values[at + q, j], values[at + r, j])),
            max(max(values[b, j], values[b + p, j]), max(values[b + q, j], values[b + r, j])),
        )
        lower = max(
            max(max(values[d, j], values[d + p, j]), max(values[d + q, j], values[d + r, j])),
            max(max(values[e, j], values[e + p, j]), max(values[e + q, j], values[e + r, j])),
        )
        most[c, m, j] = wanted[j] & max(upper, lower)
    for j in range(GROUP):
        sums[c, j] += max(np.float32(most[c, m, j]) - low, zero)
    for j in range(GROUP):
        support[c, j] += np.uint8((most[c, m, j] >= enough) & (support[c, j] < cap))


@_inline
def _add_keypoints(people, reach, v, wanted, u0, u1, w0, w1, less, enough, most, sums, support, c, m):
    """As `look`, for the keypoints of the joints of a mask in pixels u0..u1, w0..w1; whether there are any."""
    found = 0
    for j in range(people.shape[1]):
        value = 0
        for i in range(people.shape[2] if wanted >> j & 1 else 0):
            if u1 >= reach[v, i, 0] and u0 <= reach[v, i, 1] and w1 >= reach[v, i, 2] and w0 <= reach[v, i, 3]:
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


@_inline
def _rectangles(views, v, x, y, z, step, h, lanes):
    """What view v sees of the halves of a box: centre x, y, z, halves `step` off it, of half side h.

    Writes into `lanes` the pixels within which all of each is that can be seen, what is seen of it, and
    the map's first and last columns and rows. Returns the layer of the pyramid in which to look there.
    """
    h = h * (1.0 + TINY) + TINY
    across = views[v, 34]
    reach, all_reach = h * across, (h + step) * across
    depth0 = views[v, 6] * x + views[v, 7] * y + views[v, 8] * z + views[v, 11]
    own, other, simple = 1.0, 0.0, depth0 - all_reach > MIN_DEPTH + TINY
    if simple and views[v, 35] > 0.0:
        own, other, simple = _bend_of_all(views, v, x, y, z, depth0, h + step)
    if simple:
        _project_halves(views, v, x, y, z, step, h, reach, own, other, lanes)
    else:
        for c in range(8):
            sees, u0, u1, w0, w1 = view_box(
                views, v, x + (step if c & 4 else -step), y + (step if c & 2 else -step),
                z + (step if c & 1 else -step), h,
            )  # fmt: skip
            lanes[SEES + c] = sees
            lanes[U0 + c], lanes[U1 + c], lanes[W0 + c], lanes[W1 + c] = u0, u1, w0, w1
    layer = 0
    if views[v, 25] > 0.0:
        wide = _cells(views, v, lanes)
        while wide > SPAN:
            layer += 1
            wide = 0
            for c in range(8):
                if lanes[SEES + c] > 0.0:
                    columns = (int(lanes[X1 + c]) >> layer) - (int(lanes[X0 + c]) >> layer)
                    rows = (int(lanes[Y1 + c]) >> layer) - (int(lanes[Y0 + c]) >> layer)
                    wide = max(wide, columns, rows)
    return layer


@_inline
def _bend_of_all(views, v, x, y, z, depth, h):
    """Slope bounds for all of a box in front of a distorting lens, and whether all of it is well within."""
    px = (views[v, 0] * x + views[v, 1] * y + views[v, 2] * z + views[v, 9]) / depth
    py = (views[v, 3] * x + views[v, 4] * y + views[v, 5] * z + views[v, 10]) / depth
    scale = h / (depth - h * views[v, 34])
    far_x = abs(px) + scale * _lean(views, v, 0, px)
    far_y = abs(py) + scale * _lean(views, v, 3, py)
    far2, end = far_x * far_x + far_y * far_y, views[v, 35]
    within = far2 < min(views[v, 22], end * end) * (1.0 - TINY)
    at = BEND + 2 * min(int(math.sqrt(far2) / end * BINS) if within else 0, BINS - 1)
    return views[v, at], views[v, at + 1], within


@_inline
def _project_halves(views, v, x, y, z, step, h, reach, own, other, lanes):
    """`view_box` for the eight halves at once, where nothing special happens."""
    r00, r01, r02, r10, r11, r12 = views[v, 0], views[v, 1], views[v, 2], views[v, 3], views[v, 4], views[v, 5]
    r20, r21, r22, tx, ty, tz = views[v, 6], views[v, 7], views[v, 8], views[v, 9], views[v, 10], views[v, 11]
    fx, skew, mx, fy, my = views[v, 12], views[v, 13], views[v, 14], views[v, 15], views[v, 16]
    k1, k2, p1, p2, k3 = views[v, 17], views[v, 18], views[v, 19], views[v, 20], views[v, 21]
    left, right, top, bottom = -0.5, views[v, 23] - 0.5, -0.5, views[v, 24] - 0.5
    for c in range(8):
        ax = x + (2.0 * (c >> 2) - 1.0) * step
        ay = y + (2.0 * (c >> 1 & 1) - 1.0) * step
        az = z + (2.0 * (c & 1) - 1.0) * step
        depth = r20 * ax + r21 * ay + r22 * az + tz
        near = 1.0 / (depth * (depth - reach))  # one division for two
        px = (r00 * ax + r01 * ay + r02 * az + tx) * (depth - reach) * near
        py = (r10 * ax + r11 * ay + r12 * az + ty) * (depth - reach) * near
        scale = h * depth * near
        lean_x = scale * (abs(r00 - px * r20) + abs(r01 - px * r21) + abs(r02 - px * r22))
        lean_y = scale * (abs(r10 - py * r20) + abs(r11 - py * r21) + abs(r12 - py * r22))
        wx, wy = own * lean_x + other * lean_y, other * lean_x + own * lean_y
        r2 = px * px + py * py
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        dx = px * radial + 2.0 * p1 * px * py + p2 * (r2 + 2.0 * px * px)
        dy = py * radial + p1 * (r2 + 2.0 * py * py) + 2.0 * p2 * px * py
        u, w = fx * dx + skew * dy + mx, fy * dy + my
        wu, ww = fx * wx + abs(skew) * wy + MARGIN, fy * wy + MARGIN
        outside = (u + wu < left) | (u - wu > right) | (w + ww < top) | (w - ww > bottom)
        across = (u - wu < left) | (u + wu > right) | (w - ww < top) | (w + ww > bottom)
        lanes[SEES + c] = 0.0 if outside else (1.0 if across else 2.0)
        lanes[U0 + c], lanes[U1 + c] = max(u - wu, left), min(u + wu, right)
        lanes[W0 + c], lanes[W1 + c] = max(w - ww, top), min(w + ww, bottom)


@_inline
def _cells(views, v, lanes):
    """Columns and rows of the map for the rectangles, and what is seen, its borders considered.

    Returns how many cells the widest rectangle spans, less one.
    """
    m0, m1, m2, m3, m4, m5 = views[v, 27], views[v, 28], views[v, 29], views[v, 30], views[v, 31], views[v, 32]
    last_x, last_y = views[v, 25] - 1.0, views[v, 26] - 1.0
    for c in range(8):
        u, wu = 0.5 * (lanes[U0 + c] + lanes[U1 + c]), 0.5 * (lanes[U1 + c] - lanes[U0 + c])
        w, ww = 0.5 * (lanes[W0 + c] + lanes[W1 + c]), 0.5 * (lanes[W1 + c] - lanes[W0 + c])
        a, b = m0 * u + m1 * w + m2, m3 * u + m4 * w + m5
        wa, wb = abs(m0) * wu + abs(m1) * ww + TINY, abs(m3) * wu + abs(m4) * ww + TINY
        outside = (a + wa < -0.5) | (a - wa > last_x + 0.5) | (b + wb < -0.5) | (b - wb > last_y + 0.5)
        across = (a - wa < -0.5) | (a + wa > last_x + 0.5) | (b - wb < -0.5) | (b + wb > last_y + 0.5)
        lanes[SEES + c] = min(lanes[SEES + c], 0.0 if outside else (1.0 if across else 2.0))
        x0, x1 = math.floor(max(a - wa, 0.0)), math.floor(min(max(a + wa, 0.0) + 1.0, last_x))
        y0, y1 = math.floor(max(b - wb, 0.0)), math.floor(min(max(b + wb, 0.0) + 1.0, last_y))
        lanes[X0 + c], lanes[X1 + c], lanes[Y0 + c], lanes[Y1 + c] = min(x0, x1), x1, min(y0, y1), y1
        widest = max(x1 - min(x0, x1), y1 - min(y0, y1))
        lanes[WIDE + c] = widest if lanes[SEES + c] > 0.0 else 0.0
    wide = 0.0
    for c in range(8):
        wide = max(wide, lanes[WIDE + c])
    return int(wide)


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


