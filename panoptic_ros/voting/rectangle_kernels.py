"""Compiled kernels that bound what a view sees of the eight halves of a box, on its image and on its map.

They call nothing outside of this file. Arrays as in `BoxScene`.
"""
from __future__ import annotations

import math

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.voting.lens_bounds import BINS

BEND = 38  # column of the first lens bound in `views`
MIN_DEPTH = 1e-3  # m, as in the pinhole camera of `geometry`
TINY = 1e-9
FAR = 1e9  # half the side of a rectangle that is not bounded, in the plane at 1 m
MARGIN = 1e-3  # px, more than rounding can do
SPAN = 3  # cells that a rectangle spans in the layer it is looked up in, less one
NONE, PART, ALL = 0, 1, 2  # of a box that a view sees
U0, U1, W0, W1, SEES, X0, X1, Y0, Y1, WIDE = range(10)  # rows of `lanes` (10, 8), a column per half

_inline = njit(cache=True, error_model="numpy", nogil=True, forceinline=True)


@_inline
def rectangles(views, v, x, y, z, step, h, lanes):
    """What view v sees of the halves of a box: centre x, y, z, halves `step` off it, of half side h.

    Writes into `lanes` the pixels within which all of each half is that can be seen, what is seen of it, and
    the first and last columns and rows of the map there, not rounded down. Returns the layer of the pyramid
    in which all of them span few cells, wherever the cells of the layer begin.
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
            lanes[SEES, c] = sees
            lanes[U0, c], lanes[U1, c], lanes[W0, c], lanes[W1, c] = u0, u1, w0, w1
    layer, span = 0, SPAN
    if views[v, 25] > 0.0:
        wide = _cells(views, v, lanes)
        while wide > span:
            layer, span = layer + 1, 2 * span
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
    seen = min(views[v, 36], end)
    within = far2 < seen * seen * (1.0 - TINY)
    at = BEND + 2 * min(int(math.sqrt(far2) / end * BINS) if within else 0, BINS - 1)
    return views[v, at], views[v, at + 1], within


@_inline
def _project_halves(views, v, x, y, z, step, h, reach, own, other, lanes):
    """`view_box` for the eight halves at once, where nothing special happens."""
    r00, r01, r02 = views[v, 0], views[v, 1], views[v, 2]
    r10, r11, r12 = views[v, 3], views[v, 4], views[v, 5]
    r20, r21, r22 = views[v, 6], views[v, 7], views[v, 8]
    tx, ty, tz = views[v, 9], views[v, 10], views[v, 11]
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
        lanes[SEES, c] = 0.0 if outside else (1.0 if across else 2.0)
        lanes[U0, c], lanes[U1, c] = max(u - wu, left), min(u + wu, right)
        lanes[W0, c], lanes[W1, c] = max(w - ww, top), min(w + ww, bottom)


@_inline
def _cells(views, v, lanes):
    """Columns and rows of the map for the rectangles, and what is seen, its borders considered.

    Returns how many cells the widest rectangle spans, less one.
    """
    m0, m1, m2 = views[v, 27], views[v, 28], views[v, 29]
    m3, m4, m5 = views[v, 30], views[v, 31], views[v, 32]
    last_x, last_y = views[v, 25] - 1.0, views[v, 26] - 1.0
    for c in range(8):
        u, wu = 0.5 * (lanes[U0, c] + lanes[U1, c]), 0.5 * (lanes[U1, c] - lanes[U0, c])
        w, ww = 0.5 * (lanes[W0, c] + lanes[W1, c]), 0.5 * (lanes[W1, c] - lanes[W0, c])
        a, b = m0 * u + m1 * w + m2, m3 * u + m4 * w + m5
        wa, wb = abs(m0) * wu + abs(m1) * ww + TINY, abs(m3) * wu + abs(m4) * ww + TINY
        outside = (a + wa < -0.5) | (a - wa > last_x + 0.5) | (b + wb < -0.5) | (b - wb > last_y + 0.5)
        across = (a - wa < -0.5) | (a + wa > last_x + 0.5) | (b - wb < -0.5) | (b + wb > last_y + 0.5)
        sees = min(lanes[SEES, c], 0.0 if outside else (1.0 if across else 2.0))
        x0, x1 = min(max(a - wa, 0.0), last_x), min(max(a + wa, 0.0) + 1.0, last_x)
        y0, y1 = min(max(b - wb, 0.0), last_y), min(max(b + wb, 0.0) + 1.0, last_y)
        wide = max(np.floor(x1) - np.floor(x0), np.floor(y1) - np.floor(y0))
        lanes[SEES, c], lanes[WIDE, c] = sees, wide if sees > 0.0 else 0.0
        lanes[X0, c], lanes[X1, c], lanes[Y0, c], lanes[Y1, c] = x0, x1, y0, y1
    left = max(max(lanes[WIDE, 0], lanes[WIDE, 1]), max(lanes[WIDE, 2], lanes[WIDE, 3]))
    return max(left, max(max(lanes[WIDE, 4], lanes[WIDE, 5]), max(lanes[WIDE, 6], lanes[WIDE, 7])))


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
    seen2, end2 = views[v, 36] ** 2, views[v, 35] ** 2
    left, top = max(abs(px) - wx, 0.0), max(abs(py) - wy, 0.0)
    r2, far2 = px * px + py * py, (abs(px) + wx) ** 2 + (abs(py) + wy) ** 2
    beyond = left * left + top * top >= seen2 * (1.0 + TINY)
    sees = NONE if beyond else ALL if far2 < seen2 * (1.0 - TINY) else PART
    # farther out than the end points are bounded only if they are not seen
    bounded = (far2 < end2 * (1.0 - TINY)) | (end2 >= seen2 * (1.0 - TINY))
    if bounded & (r2 < end2 * (1.0 - TINY)):
        at = BEND + 2 * min(int(math.sqrt(far2 / end2) * BINS), BINS - 1)
        p1, p2 = views[v, 19], views[v, 20]
        radial = 1.0 + r2 * (views[v, 17] + r2 * (views[v, 18] + r2 * views[v, 21]))
        dx = px * radial + 2.0 * p1 * px * py + p2 * (r2 + 2.0 * px * px)
        dy = py * radial + p1 * (r2 + 2.0 * py * py) + 2.0 * p2 * px * py
        own, other = views[v, at], views[v, at + 1]
        px, py, wx, wy = dx, dy, own * wx + other * wy, other * wx + own * wy
    else:
        sees, px, py, wx, wy = min(sees, PART), 0.0, 0.0, FAR, FAR
    return sees, px, py, wx, wy


