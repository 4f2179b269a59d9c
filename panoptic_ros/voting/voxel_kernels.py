"""Compiled kernels of the exact search: eq. 1 at the voxels of boxes.

The eight voxels of a box are projected side by side, with the very operations of `kernels.vote`.
"""
from __future__ import annotations

import math

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.solving.lens_kernels import fisheye_factor
from panoptic_ros.voting.box_kernels import GROUP
from panoptic_ros.voting.kernels import hidden
from panoptic_ros.voting.score_field import GAUSSIAN_END

MIN_DEPTH = 1e-3  # m, as in the pinhole camera of `geometry`
COVERED, U, W, A, B, CELL = range(0, 48, 8)  # in `lanes` (48,), see `_project`

_jit = njit(cache=True, error_model="numpy", nogil=True)
_inline = njit(cache=True, error_model="numpy", nogil=True, forceinline=True)


@_jit
def visit(scene, boxes, start, lists, lower, shape, side, threshold, view_threshold, least):
    """All voxels of boxes with votes above the threshold that at least `least` views support.

    Args:
        scene: `BoxScene`.
        boxes, start, lists: of `box_kernels.split`, level 1.

    Returns:
        found (N, 6) joints, voxels, supporting views, 1 for the first voxel of the most votes in its box;
        votes (N,), those of `kernels.vote`.
    """
    views, _, _, _, people, _, _, map_start, map_data, limits, _, _ = scene
    lanes, mine, total, covering = np.zeros(48), np.zeros(GROUP, np.int64), 0, np.zeros(8)
    sums, support = np.zeros((GROUP, 8)), np.zeros((GROUP, 8), np.int64)
    found, votes = np.zeros((1024, 6), np.int64), np.zeros(1024)
    for n in range(len(boxes)):
        count = 0
        for joint in range(people.shape[1]):
            mine[count] = joint
            count += boxes[n, 3] >> joint & 1
        sums[:count], support[:count], covering[:] = 0.0, 0, boxes[n, 4]
        i, j, k = 2 * boxes[n, 0] + lower[0], 2 * boxes[n, 1] + lower[1], 2 * boxes[n, 2] + lower[2]
        for at in range(start[n], start[n + 1]):
            v, some = lists[at]
            if views[v].fisheye > 0.0:
                _project(views, v, i, j, k, side, True, lanes)
            else:
                _project(views, v, i, j, k, side, False, lanes)
            if limits[3 * v] > 0.0:
                _hide(views, limits, v, i, j, k, side, lanes)
            for c in range(8):
                covering[c] += lanes[COVERED + c]
            if some == 0:
                continue
            view = views[v]
            right = np.int64(view.columns > 1.0)  # how much farther cells to the right and below are
            below = np.int64(view.columns) if view.rows > 1.0 else 0
            for m in range(count):
                if not some >> mine[m] & 1:
                    continue
                first = map_start[v, mine[m]]
                if first >= 0:
                    _add_samples(map_data, first, right, below, lanes, m, view_threshold, sums, support)
                else:
                    _add_gaussians(people, v, mine[m], m, lanes, view_threshold, sums, support)
        if total + 8 * GROUP > len(votes):
            found = np.concatenate((found, np.zeros_like(found)))
            votes = np.concatenate((votes, np.zeros_like(votes)))
        for m in range(count):
            best = total
            for c in range(8):
                vote = sums[m, c] / covering[c] if covering[c] > 0.0 else 0.0
                if not (vote > threshold and support[m, c] >= least):
                    continue
                a, b, d = i + (c >> 2), j + (c >> 1 & 1), k + (c & 1)
                if a >= lower[0] + shape[0] or b >= lower[1] + shape[1] or d >= lower[2] + shape[2]:
                    continue
                found[total, 0], found[total, 4], votes[total] = mine[m], support[m, c], vote
                found[total, 1], found[total, 2], found[total, 3], found[total, 5] = a, b, d, 0
                best = total if vote > votes[best] else best
                total += 1
            found[best, 5] = 1
    return found[:total], votes[:total]


@_inline
def _hide(views, limits, v, i, j, k, side, lanes):
    """What view v covers of the eight voxels from i, j, k on, less what lies beyond its limit."""
    for c in range(8):
        if lanes[COVERED + c] > 0.0:
            x, y, z = (i + (c >> 2) + 0.5) * side, (j + (c >> 1 & 1) + 0.5) * side, (k + (c & 1) + 0.5) * side
            if hidden(views, limits, v, x, y, z, lanes[U + c], lanes[W + c]):
                lanes[COVERED + c] = 0.0


@_inline
def _add_samples(data, first, right, below, lanes, m, view_threshold, sums, support):
    """Add what a map shows of a joint at the eight voxels to row m of the sums and of the support."""
    for c in range(8):
        fx, fy, at = lanes[A + c], lanes[B + c], first + np.int64(lanes[CELL + c])
        top = data[at] * (1.0 - fx) + data[at + right] * fx
        bottom = data[at + below] * (1.0 - fx) + data[at + below + right] * fx
        score = (top * (1.0 - fy) + bottom * fy) / 255.0 * lanes[COVERED + c]
        sums[m, c] += score
        support[m, c] += score > view_threshold


@_inline
def _add_gaussians(people, v, joint, m, lanes, view_threshold, sums, support):
    """As `_add_samples`, for keypoints."""
    for c in range(8):
        score = 0.0
        for p in range(people.shape[2] if lanes[COVERED + c] > 0.0 else 0):
            dx, dy = people[v, joint, p, 0] - lanes[U + c], people[v, joint, p, 1] - lanes[W + c]
            exponent = (dx * dx + dy * dy) * people[v, joint, p, 2]
            if exponent < GAUSSIAN_END:
                score = max(score, people[v, joint, p, 3] * math.exp(-exponent))
        sums[m, c] += score
        support[m, c] += score > view_threshold


@_inline
def _project(views, v, i, j, k, side, fisheye, lanes):
    """Where view v sees the eight voxels from i, j, k on, step by step as in `kernels`.

    The kind of the lens is an argument so that each has a loop without branches.

    Writes into `lanes` whether it covers them; pixels; how far they are beyond a cell of the map, of 0 to 1;
    and the number of that cell.
    """
    view = views[v]
    r00, r01, r02 = view.r00, view.r01, view.r02
    r10, r11, r12 = view.r10, view.r11, view.r12
    r20, r21, r22 = view.r20, view.r21, view.r22
    tx, ty, tz = view.tx, view.ty, view.tz
    fx, skew, mx, fy, my = view.fx, view.skew, view.cx, view.fy, view.cy
    k1, k2, p1, p2, k3, k4, fold = view.k1, view.k2, view.p1, view.p2, view.k3, view.k4, view.fold
    right, bottom, map_right, map_bottom = view.width - 0.5, view.height - 0.5, view.columns, view.rows
    m0, m1, m2 = view.a0, view.a1, view.a2
    m3, m4, m5 = view.b0, view.b1, view.b2
    bare = map_right == 0.0  # no maps, no borders of theirs
    last_x, last_y = max(map_right - 1.0, 0.0), max(map_bottom - 1.0, 0.0)
    for c in range(8):
        x, y, z = (i + (c >> 2) + 0.5) * side, (j + (c >> 1 & 1) + 0.5) * side, (k + (c & 1) + 0.5) * side
        depth = r20 * x + r21 * y + r22 * z + tz
        px = (r00 * x + r01 * y + r02 * z + tx) / depth
        py = (r10 * x + r11 * y + r12 * z + ty) / depth
        r2 = px * px + py * py
        radial = fisheye_factor(k1, k2, k3, k4, r2) if fisheye else 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        dx = px * radial + 2.0 * p1 * px * py + p2 * (r2 + 2.0 * px * px)
        dy = py * radial + p1 * (r2 + 2.0 * py * py) + 2.0 * p2 * px * py
        u = fx * dx + skew * dy + mx
        w = fy * dy + my
        a = m0 * u + m1 * w + m2
        b = m3 * u + m4 * w + m5
        covered = (depth > MIN_DEPTH) & (r2 < fold) & (-0.5 <= u) & (u <= right) & (-0.5 <= w) & (w <= bottom)
        mapped = (-0.5 <= a) & (a <= map_right - 0.5) & (-0.5 <= b) & (b <= map_bottom - 0.5)
        lanes[COVERED + c] = 1.0 if covered & (mapped | bare) else 0.0
        a, b = min(max(a if covered else 0.0, 0.0), last_x), min(max(b if covered else 0.0, 0.0), last_y)
        x, y = np.floor(min(a, max(last_x - 1.0, 0.0))), np.floor(min(b, max(last_y - 1.0, 0.0)))
        lanes[U + c], lanes[W + c], lanes[A + c], lanes[B + c] = u, w, a - x, b - y
        lanes[CELL + c] = y * map_right + x
