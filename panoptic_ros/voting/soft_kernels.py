"""Compiled kernels of the soft vote.

The loops over the points of a ball are written so that the compiler can vectorise them: flat arrays,
no branches, a Gaussian without library calls (relative error below 1e-5).
"""
from __future__ import annotations

import math

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.solving.lens_kernels import fisheye_factor, fisheye_slope
from panoptic_ros.voting.kernels import hidden, project
from panoptic_ros.voting.score_field import GAUSSIAN_END

MIN_DEPTH = 1e-3  # m, as in the pinhole camera of `geometry`
FAR = 8.0  # a ball that is so many times its size away is seen as by a camera at infinity
REACH = 3.0  # a ball off the axis of a distorted lens is not larger than this, relative to its size on it
MANY_VIEWS = 10  # place a joint so well that the widest ball would find nothing better
SETTLED = 1e-4  # m, a step that ends the rounds

_jit = njit(cache=True, error_model="numpy", nogil=True)
_inline = njit(cache=True, error_model="numpy", nogil=True, forceinline=True)


@_jit
def move_to_votes(scene, joints, starts, ball, radii, rounds, softness):
    """Where starts (N, 3) of joints (N,) come to, step by step to the mean of the points of a ball.

    A place moves to the mean of the points (3, G) of a ball of radius 1 about it, scaled by each of the radii
    in turn (the first is for places that few views see), weighted by exp(vote / softness); with each up to
    `rounds` times, or until it stays. The vote is eq. 1 of the views that see the place. Where nothing
    votes, it stays. The points lie along the axes of the nearest camera that sees the start, so that the
    frame of the world does not matter.
    """
    places = starts.copy()
    turned, scratch = np.empty_like(ball), np.empty((7, ball.shape[1]))
    for n in range(len(starts)):
        nearest, seeing = _nearest_view(scene, starts[n])
        if nearest < 0:
            continue
        _turn(ball, scene.cameras[nearest], turned)
        for radius in radii if seeing < MANY_VIEWS else radii[1:]:
            for _ in range(rounds):
                if _step(scene, joints[n], places[n], radius, turned, softness, scratch) < SETTLED:
                    break
    return places


@_jit
def _nearest_view(scene, place):
    """The view that sees a place (3,) from the smallest depth, -1 if none does; and how many do."""
    cameras = scene.cameras
    nearest, least, seeing = -1, np.inf, 0
    x, y, z = place
    for v in range(len(cameras)):
        camera = cameras[v]
        depth = camera.r20 * x + camera.r21 * y + camera.r22 * z + camera.tz
        u, w, _, _, covered = project(cameras, v, x, y, z)
        if covered and not hidden(cameras, scene.limits, v, x, y, z, u, w):
            seeing += 1
            if depth < least:
                nearest, least = v, depth
    return nearest, seeing


@_jit
def _turn(ball, camera, turned):
    """Points (3, G) along the axes of a camera, in the world."""
    for g in range(ball.shape[1]):
        x, y, z = ball[0, g], ball[1, g], ball[2, g]
        turned[0, g] = camera.r00 * x + camera.r10 * y + camera.r20 * z
        turned[1, g] = camera.r01 * x + camera.r11 * y + camera.r21 * z
        turned[2, g] = camera.r02 * x + camera.r12 * y + camera.r22 * z


@_jit
def _step(scene, joint, place, radius, ball, softness, scratch):
    """One step of a place (3,), changed in place; returns its length. The scratch space is (7, G)."""
    cameras, people, map_start, map_data = scene.cameras, scene.people, scene.map_start, scene.map_data
    offsets, votes, scores, u, w = scratch[:3], scratch[3], scratch[4], scratch[5], scratch[6]
    for i in range(3):
        for g in range(ball.shape[1]):
            offsets[i, g] = radius * ball[i, g]
    votes[:] = 0.0
    middle, joint_count = len(votes) // 2, map_start.shape[1]  # of the points the middle one is the place
    frame = np.empty(10)
    covering = 0
    for v in range(len(cameras)):
        if scene.limits[3 * v] > 0.0:
            x, y, z = place
            at_u, at_w, _, _, covered = project(cameras, v, x, y, z)
            if covered and hidden(cameras, scene.limits, v, x, y, z, at_u, at_w):
                continue
        if map_start[v, joint] >= 0 and _frame(cameras, v, place, radius, frame):
            covering += 1
            if _near_patch(scene.patch_start, scene.patch_table, v * joint_count + joint, frame):
                _add_framed_map(map_data, map_start[v, joint], int(cameras[v].columns), frame, offsets, votes)
            continue
        reach = REACH * _project_ball(cameras[v], place, radius, offsets, u, w)
        if u[middle] == np.inf:
            continue
        covering += 1
        if map_start[v, joint] >= 0:
            _add_map(cameras, v, map_start[v, joint], map_data, u, w, votes)
        else:
            scores[:] = 0.0
            for i in range(people.shape[2]):
                seen = people[v, joint, i]
                away = math.hypot(seen[0] - u[middle], seen[1] - w[middle])
                if away < reach + math.sqrt(GAUSSIAN_END / seen[2]):  # False if it is missing
                    _raise_to_keypoint(seen, u, w, scores)
            for g in range(len(votes)):
                votes[g] += scores[g]
    return _move_to_mean(place, offsets, votes, softness * covering, scores)


@_jit
def _project_ball(camera, start, radius, offsets, u, w):
    """Pixels u, w (G,) of start + offsets; infinite where the view does not cover them.

    Returns the size of the ball in pixels where the view looks straight at it; inf if it is too close.
    """
    if camera.fisheye > 0.0:
        depth = _project_points(camera, start, offsets, True, u, w)
    else:
        depth = _project_points(camera, start, offsets, False, u, w)
    return radius * max(camera.fx, camera.fy) / depth if depth > 4.0 * radius else np.inf


@_inline
def _project_points(camera, start, offsets, fisheye, u, w):
    """Write the pixels of `_project_ball`; returns the depth of the start.

    The kind of the lens is an argument so that each has a loop without branches.
    """
    r00, r01, r02, tx = camera.r00, camera.r01, camera.r02, camera.tx
    r10, r11, r12, ty = camera.r10, camera.r11, camera.r12, camera.ty
    r20, r21, r22, tz = camera.r20, camera.r21, camera.r22, camera.tz
    fx, skew, cx, fy, cy = camera.fx, camera.skew, camera.cx, camera.fy, camera.cy
    k1, k2, p1, p2, k3, k4 = camera.k1, camera.k2, camera.p1, camera.p2, camera.k3, camera.k4
    width, height, map_width, map_height = camera.width, camera.height, camera.columns, camera.rows
    a0, a1, a2, b0, b1, b2 = camera.a0, camera.a1, camera.a2, camera.b0, camera.b1, camera.b2
    x0 = r00 * start[0] + r01 * start[1] + r02 * start[2] + tx
    y0 = r10 * start[0] + r11 * start[1] + r12 * start[2] + ty
    z0 = r20 * start[0] + r21 * start[1] + r22 * start[2] + tz
    if map_width == 0.0:  # no maps, no borders of theirs
        map_width = map_height = 1.0
    for g in range(len(u)):
        ox, oy, oz = offsets[0, g], offsets[1, g], offsets[2, g]
        depth = z0 + r20 * ox + r21 * oy + r22 * oz
        scale = 1.0 / max(depth, MIN_DEPTH)
        x = (x0 + r00 * ox + r01 * oy + r02 * oz) * scale
        y = (y0 + r10 * ox + r11 * oy + r12 * oz) * scale
        r2 = x * x + y * y
        radial = fisheye_factor(k1, k2, k3, k4, r2) if fisheye else 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        dx = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
        dy = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
        px, py = fx * dx + skew * dy + cx, fy * dy + cy
        a, b = a0 * px + a1 * py + a2, b0 * px + b1 * py + b2
        inside = (
            (depth > MIN_DEPTH) & (r2 < camera.fold)
            & (px >= -0.5) & (px <= width - 0.5) & (py >= -0.5) & (py <= height - 0.5)
            & (a >= -0.5) & (a <= map_width - 0.5) & (b >= -0.5) & (b <= map_height - 0.5)
        )  # fmt: skip
        u[g] = px if inside else np.inf
        w[g] = py if inside else np.inf
    return z0


@_jit
def _frame(cameras, v, start, radius, frame):
    """How a ball lies on the map of view v: cell a, b of its centre, how a and b change with x, y, z, size.

    Returns whether the view covers all of it, from far enough for this to be linear (to a hundredth of
    the ball where it is 12 cm at 3 m).
    """
    camera = cameras[v]
    r00, r01, r02, tx = camera.r00, camera.r01, camera.r02, camera.tx
    r10, r11, r12, ty = camera.r10, camera.r11, camera.r12, camera.ty
    r20, r21, r22, tz = camera.r20, camera.r21, camera.r22, camera.tz
    fx, skew, cx, fy, cy = camera.fx, camera.skew, camera.cx, camera.fy, camera.cy
    k1, k2, p1, p2, k3, fold = camera.k1, camera.k2, camera.p1, camera.p2, camera.k3, camera.fold
    width, height, map_width, map_height = camera.width, camera.height, camera.columns, camera.rows
    a0, a1, a2, b0, b1, b2 = camera.a0, camera.a1, camera.a2, camera.b0, camera.b1, camera.b2
    depth = r20 * start[0] + r21 * start[1] + r22 * start[2] + tz
    if depth < FAR * radius:
        return False
    scale = 1.0 / depth
    x = (r00 * start[0] + r01 * start[1] + r02 * start[2] + tx) * scale
    y = (r10 * start[0] + r11 * start[1] + r12 * start[2] + ty) * scale
    r2 = x * x + y * y
    wide = math.sqrt(r2) + 2.0 * radius * scale
    if wide * wide >= fold:
        return False
    if camera.fisheye > 0.0:
        radial = fisheye_factor(k1, k2, k3, camera.k4, r2)
        slope = fisheye_slope(k1, k2, k3, camera.k4, r2, radial)
    else:
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3))
    dx = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    dy = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    xx = radial + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
    xy = x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
    yy = radial + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
    px, py = fx * dx + skew * dy + cx, fy * dy + cy
    ux, uy, wx, wy = fx * xx + skew * xy, fx * xy + skew * yy, fy * xy, fy * yy
    frame[0], frame[1] = a0 * px + a1 * py + a2, b0 * px + b1 * py + b2
    ax, ay = (a0 * ux + a1 * wx) * scale, (a0 * uy + a1 * wy) * scale
    bx, by = (b0 * ux + b1 * wx) * scale, (b0 * uy + b1 * wy) * scale
    frame[2], frame[3], frame[4] = (
        ax * (r00 - x * r20) + ay * (r10 - y * r20), ax * (r01 - x * r21) + ay * (r11 - y * r21),
        ax * (r02 - x * r22) + ay * (r12 - y * r22),
    )  # fmt: skip
    frame[5], frame[6], frame[7] = (
        bx * (r00 - x * r20) + by * (r10 - y * r20), bx * (r01 - x * r21) + by * (r11 - y * r21),
        bx * (r02 - x * r22) + by * (r12 - y * r22),
    )  # fmt: skip
    wide_a = radius * math.sqrt(frame[2] ** 2 + frame[3] ** 2 + frame[4] ** 2)
    wide_b = radius * math.sqrt(frame[5] ** 2 + frame[6] ** 2 + frame[7] ** 2)
    frame[8], frame[9] = wide_a, wide_b
    det = abs(a0 * b1 - a1 * b0)  # how far the ball reaches in pixels, at most
    wide_u = (abs(b1) * wide_a + abs(a1) * wide_b) / det
    wide_w = (abs(b0) * wide_a + abs(a0) * wide_b) / det
    return (
        px - wide_u >= -0.5 and px + wide_u <= width - 0.5
        and py - wide_w >= -0.5 and py + wide_w <= height - 0.5
        and frame[0] - wide_a > 0.0 and frame[0] + wide_a < map_width - 1.0
        and frame[1] - wide_b > 0.0 and frame[1] + wide_b < map_height - 1.0
    )  # fmt: skip


@_jit
def _near_patch(patch_start, patch_table, key, frame):
    """Whether a patch of a view and joint has a cell that a sample in the ball may read."""
    low_a, high_a = frame[0] - frame[8] - 1.0, frame[0] + frame[8] + 1.0
    low_b, high_b = frame[1] - frame[9] - 1.0, frame[1] + frame[9] + 1.0
    for k in range(patch_start[key], patch_start[key + 1]):
        column, row = patch_table[k, 1], patch_table[k, 2]
        right, below = column + patch_table[k, 3], row + patch_table[k, 4]
        if low_a < right and high_a >= column and low_b < below and high_b >= row:
            return True
    return False


@_jit
def _add_framed_map(data, start, width, frame, offsets, votes):
    """Add bilinear samples of a map of so many columns that begins at `start`."""
    a0, b0, ax, ay, az = frame[0], frame[1], frame[2], frame[3], frame[4]
    bx, by, bz = frame[5], frame[6], frame[7]
    for g in range(len(votes)):
        ox, oy, oz = offsets[0, g], offsets[1, g], offsets[2, g]
        a, b = a0 + ax * ox + ay * oy + az * oz, b0 + bx * ox + by * oy + bz * oz
        x, y = int(a), int(b)
        fx, fy = a - x, b - y
        at = start + y * width + x
        left = data[at] + (float(data[at + width]) - data[at]) * fy
        right = data[at + 1] + (float(data[at + width + 1]) - data[at + 1]) * fy
        votes[g] += (left + (right - left) * fx) * (1.0 / 255.0)


@_jit
def _add_map(cameras, v, start, data, u, w, votes):
    """Add bilinear samples of the map of view v that begins at `start`."""
    camera = cameras[v]
    width, height = int(camera.columns), int(camera.rows)
    a0, a1, a2, b0, b1, b2 = camera.a0, camera.a1, camera.a2, camera.b0, camera.b1, camera.b2
    for g in range(len(u)):
        if u[g] == np.inf:
            continue
        a = min(max(a0 * u[g] + a1 * w[g] + a2, 0.0), width - 1.0)
        b = min(max(b0 * u[g] + b1 * w[g] + b2, 0.0), height - 1.0)
        x, y = min(int(a), max(width - 2, 0)), min(int(b), max(height - 2, 0))
        fx, fy = a - x, b - y
        at = start + y * width + x
        right = 1 if x + 1 < width else 0
        below = width if y + 1 < height else 0
        top = data[at] * (1.0 - fx) + data[at + right] * fx
        bottom = data[at + below] * (1.0 - fx) + data[at + below + right] * fx
        votes[g] += (top * (1.0 - fy) + bottom * fy) * (1.0 / 255.0)


@_jit
def _raise_to_keypoint(joint, u, w, scores):
    """Scores (G,) become at least the Gaussian of a 2D joint (pixel, rate, score)."""
    x, y, rate, score = joint
    for g in range(len(u)):
        exponent = min(((x - u[g]) ** 2 + (y - w[g]) ** 2) * rate, 2.0 * GAUSSIAN_END)
        value = _decay(exponent)
        scores[g] = max(scores[g], score * value if exponent < GAUSSIAN_END else 0.0)


@_jit
def _decay(x):
    """exp(-x) for 0 <= x <= 12."""
    part = x / 64.0
    value = 1.0 - part * (1.0 - part * (0.5 - part * (1.0 / 6.0 - part / 24.0)))
    value *= value
    value *= value
    value *= value
    value *= value
    value *= value
    value *= value
    return value


@_jit
def _move_to_mean(place, offsets, votes, softness, weights):
    """Move a place (3,) by the mean of the offsets (3, G), weighted by exp(vote / softness); how far."""
    best = votes[0]
    for g in range(len(votes)):
        best = max(best, votes[g])
    if not best > 0.0:
        return 0.0
    rate = 1.0 / softness
    for g in range(len(votes)):
        worse = min((best - votes[g]) * rate, 2.0 * GAUSSIAN_END)
        weights[g] = _decay(worse) if worse < 2.0 * GAUSSIAN_END else 0.0
    total, x, y, z = 0.0, 0.0, 0.0, 0.0
    for g in range(len(votes)):
        total += weights[g]
        x += weights[g] * offsets[0, g]
        y += weights[g] * offsets[1, g]
        z += weights[g] * offsets[2, g]
    place[0] += x / total
    place[1] += y / total
    place[2] += z / total
    return math.sqrt(x * x + y * y + z * z) / total
