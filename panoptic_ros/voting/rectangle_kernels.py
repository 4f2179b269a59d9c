"""Compiled kernels that bound what a view sees of the eight halves of a box, on its image and on its map."""
from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from panoptic_ros.geometry.pinhole import MIN_DEPTH
from panoptic_ros.kernels import inlined
from panoptic_ros.voting.lanes import bent
from panoptic_ros.voting.lens_bounds import BINS

TINY = 1e-9
FAR = 1e9  # half the side of a rectangle that is not bounded, in the plane at 1 m
MARGIN = 1e-3  # px, more than rounding can do
SPAN = 3  # cells that a rectangle spans in the layer it is looked up in, less one
NONE, PART, ALL = 0, 1, 2  # of a box that a view sees
U0, U1, W0, W1, SEES, X0, X1, Y0, Y1, WIDE = range(10)  # rows of `lanes` (10, 8), a column per half


class Box(NamedTuple):
    """The centre of a box, m; its halves are `step` off it along each axis, and of half side `half`."""

    x: float
    y: float
    z: float
    step: float
    half: float


@inlined
def corner(box, c):
    """The centre of half c."""
    step = box.step
    return (
        box.x + (2.0 * (c >> 2) - 1.0) * step, box.y + (2.0 * (c >> 1 & 1) - 1.0) * step,
        box.z + (2.0 * (c & 1) - 1.0) * step,
    )  # fmt: skip


@inlined
def rectangles(scene, v, box, lanes):
    """What view v of a `BoxScene` sees of the halves of a box.

    Writes into `lanes` the pixels within which all of each half is that can be seen, what is seen of it, and
    the first and last columns and rows of the map there, not rounded down. Returns the layer of the pyramid
    in which all of them span few cells, wherever the cells of the layer begin.
    """
    view, bounds = scene.cameras[v], scene.bounds[v]
    half = box.half * (1.0 + TINY) + TINY
    depth = view.r20 * box.x + view.r21 * box.y + view.r22 * box.z + view.tz
    own, other, simple = 1.0, 0.0, depth - (half + box.step) * bounds.across > MIN_DEPTH + TINY
    if simple and bounds.bend_end > 0.0:
        own, other, simple = _bend_of_all(view, bounds, box, depth, half + box.step)
    if simple and view.fisheye > 0.0:
        _project_halves(view, box, half, half * bounds.across, (own, other), True, lanes)
    elif simple:
        _project_halves(view, box, half, half * bounds.across, (own, other), False, lanes)
    else:
        for c in range(8):
            sees, u0, u1, w0, w1 = view_box(view, bounds, corner(box, c), half)
            lanes[SEES, c] = sees
            lanes[U0, c], lanes[U1, c], lanes[W0, c], lanes[W1, c] = u0, u1, w0, w1
    layer, span = 0, SPAN
    if view.columns > 0.0:
        wide = _cells(view, lanes)
        while wide > span:
            layer, span = layer + 1, 2 * span
    return layer


@inlined
def _bend_of_all(view, bounds, box, depth, half):
    """Slope bounds for all of a box in front of a distorting lens, and whether all of it is well within."""
    px = (view.r00 * box.x + view.r01 * box.y + view.r02 * box.z + view.tx) / depth
    py = (view.r10 * box.x + view.r11 * box.y + view.r12 * box.z + view.ty) / depth
    scale = half / (depth - half * bounds.across)
    far_x, far_y = abs(px) + scale * _lean_x(view, px), abs(py) + scale * _lean_y(view, py)
    far2, end = far_x * far_x + far_y * far_y, bounds.bend_end
    seen = min(bounds.far_x, end)
    within = far2 < seen * seen * (1.0 - TINY)
    at = min(int(math.sqrt(far2) / end * BINS) if within else 0, BINS - 1)
    return bounds.bends[at, 0], bounds.bends[at, 1], within


@inlined
def _project_halves(view, box, half, reach, slopes, fisheye, lanes):
    """`view_box` for the eight halves at once, where nothing special happens.

    The kind of the lens is an argument so that each has a loop without branches.
    """
    own, other = slopes
    r00, r01, r02, tx = view.r00, view.r01, view.r02, view.tx
    r10, r11, r12, ty = view.r10, view.r11, view.r12, view.ty
    r20, r21, r22, tz = view.r20, view.r21, view.r22, view.tz
    fx, skew, mx, fy, my = view.fx, view.skew, view.cx, view.fy, view.cy
    terms = (view.k1, view.k2, view.p1, view.p2, view.k3, view.k4)
    left, right, top, bottom = -0.5, view.width - 0.5, -0.5, view.height - 0.5
    for c in range(8):
        ax, ay, az = corner(box, c)
        depth = r20 * ax + r21 * ay + r22 * az + tz
        near = 1.0 / (depth * (depth - reach))  # one division for two
        px = (r00 * ax + r01 * ay + r02 * az + tx) * (depth - reach) * near
        py = (r10 * ax + r11 * ay + r12 * az + ty) * (depth - reach) * near
        scale = half * depth * near
        lean_x = scale * (abs(r00 - px * r20) + abs(r01 - px * r21) + abs(r02 - px * r22))
        lean_y = scale * (abs(r10 - py * r20) + abs(r11 - py * r21) + abs(r12 - py * r22))
        wx, wy = own * lean_x + other * lean_y, other * lean_x + own * lean_y
        dx, dy, _ = bent(terms, fisheye, px, py)
        u, w = fx * dx + skew * dy + mx, fy * dy + my
        wu, ww = fx * wx + abs(skew) * wy + MARGIN, fy * wy + MARGIN
        outside = (u + wu < left) | (u - wu > right) | (w + ww < top) | (w - ww > bottom)
        across = (u - wu < left) | (u + wu > right) | (w - ww < top) | (w + ww > bottom)
        lanes[SEES, c] = 0.0 if outside else (1.0 if across else 2.0)
        lanes[U0, c], lanes[U1, c] = max(u - wu, left), min(u + wu, right)
        lanes[W0, c], lanes[W1, c] = max(w - ww, top), min(w + ww, bottom)


@inlined
def _cells(view, lanes):
    """Columns and rows of the map for the rectangles, and what is seen, its borders considered.

    Returns how many cells the widest rectangle spans, less one.
    """
    m0, m1, m2 = view.a0, view.a1, view.a2
    m3, m4, m5 = view.b0, view.b1, view.b2
    last_x, last_y = view.columns - 1.0, view.rows - 1.0
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


@inlined
def view_box(view, bounds, centre, half):
    """What a view sees of a box of this centre and half side.

    Returns NONE, PART or ALL, and the pixels u0, u1, w0, w1 within which all of it is that can be seen.
    """
    (x, y, z), sees, u, w, wu, ww = centre, NONE, 0.0, 0.0, FAR, FAR
    depth = view.r20 * x + view.r21 * y + view.r22 * z + view.tz
    reach = half * bounds.across
    cx = view.r00 * x + view.r01 * y + view.r02 * z + view.tx
    cy = view.r10 * x + view.r11 * y + view.r12 * z + view.ty
    if depth - reach > MIN_DEPTH + TINY:
        near = 1.0 / (depth * (depth - reach))  # one division for two
        px, py, scale = cx * (depth - reach) * near, cy * (depth - reach) * near, half * depth * near
        wx, wy = scale * _lean_x(view, px), scale * _lean_y(view, py)
        sees = ALL
        if bounds.bend_end > 0.0:
            sees, px, py, wx, wy = _bend(view, bounds, px, py, wx, wy)
        u = view.fx * px + view.skew * py + view.cx
        w = view.fy * py + view.cy
        wu = view.fx * wx + abs(view.skew) * wy + MARGIN
        ww = view.fy * wy + MARGIN
    elif depth + reach > MIN_DEPTH - TINY:  # across the plane of the camera: anywhere, or far beside
        far = depth + reach + TINY
        beside_x = abs(cx) - half * _lean_x(view, 0.0) - TINY
        beside_y = abs(cy) - half * _lean_y(view, 0.0) - TINY
        sees = NONE if (beside_x > bounds.far_x * far) | (beside_y > bounds.far_y * far) else PART
    u0, u1, w0, w1 = -0.5, view.width - 0.5, -0.5, view.height - 0.5
    outside = (u + wu < u0) | (u - wu > u1) | (w + ww < w0) | (w - ww > w1)
    across = (u - wu < u0) | (u + wu > u1) | (w - ww < w0) | (w + ww > w1)
    sees = min(sees, NONE if outside else PART if across else ALL)
    return sees, max(u - wu, u0), min(u + wu, u1), max(w - ww, w0), min(w + ww, w1)


@inlined
def _lean_x(view, slope):
    """How fast X - slope * Z changes at most, per half side of a box; X, Y, Z in the camera."""
    x, y, z = view.r00 - slope * view.r20, view.r01 - slope * view.r21, view.r02 - slope * view.r22
    return abs(x) + abs(y) + abs(z)


@inlined
def _lean_y(view, slope):
    """As `_lean_x`, of Y - slope * Z."""
    x, y, z = view.r10 - slope * view.r20, view.r11 - slope * view.r21, view.r12 - slope * view.r22
    return abs(x) + abs(y) + abs(z)


@inlined
def _bend(view, bounds, px, py, wx, wy):
    """The distorted middle and half sides of a rectangle of the image plane, infinite if not bounded."""
    seen2, end2 = bounds.far_x**2, bounds.bend_end**2
    left, top = max(abs(px) - wx, 0.0), max(abs(py) - wy, 0.0)
    r2, far2 = px * px + py * py, (abs(px) + wx) ** 2 + (abs(py) + wy) ** 2
    beyond = left * left + top * top >= seen2 * (1.0 + TINY)
    sees = NONE if beyond else ALL if far2 < seen2 * (1.0 - TINY) else PART
    # farther out than the end points are bounded only if they are not seen
    bounded = (far2 < end2 * (1.0 - TINY)) | (end2 >= seen2 * (1.0 - TINY))
    if bounded & (r2 < end2 * (1.0 - TINY)):
        at = min(int(math.sqrt(far2 / end2) * BINS), BINS - 1)
        own, other = bounds.bends[at, 0], bounds.bends[at, 1]
        terms = (view.k1, view.k2, view.p1, view.p2, view.k3, view.k4)
        px, py, _ = bent(terms, view.fisheye > 0.0, px, py)
        wx, wy = own * wx + other * wy, other * wx + own * wy
    else:
        sees, px, py, wx, wy = min(sees, PART), 0.0, 0.0, FAR, FAR
    return sees, px, py, wx, wy
