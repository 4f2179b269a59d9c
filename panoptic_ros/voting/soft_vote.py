"""Sub-voxel positions: soft-argmax of the vote of eq. 1 in a ball round a point.

Each view projects the centre of the ball and six points of its surface. The depths, cells and pixels of the
other points are interpolated as in a pinhole camera, because lenses bend little within a ball.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from panoptic_ros.kernels import inlined, njit
from panoptic_ros.voting.proposals import NodeProposals
from panoptic_ros.voting.scene import VoteScene
from panoptic_ros.voting.votes import (
    COVERED,
    DEPTH,
    GAUSSIAN_END,
    LANES,
    SIZE,
    A,
    B,
    PointMotion,
    U,
    W,
    at_rest,
    gaussian,
    locate,
    place,
    sample,
    see,
    strides,
    vote_points,
)

Array = np.ndarray
MANY_VIEWS = 10  # number of views that place a joint so well that the largest ball would not improve it
SOFTNESS = 0.05  # difference of votes that lowers a weight to 1/e
RADII = np.array([0.12, 0.08, 0.03])  # m, radii of the balls
POINTS = 40  # greatest number of points of a ball: a multiple of the vector length
BALL_X, BALL_Y, BALL_Z, CELLS, RIGHTS, BELOWS, VOTES, SCORES, WEIGHTS = range(0, 9 * POINTS, POINTS)
ROWS = 9 * POINTS
WIDEST = 2.0  # greatest image distance of a ball point from the centre, relative to the surface points
CLOSE = 2.0  # least depth of a ball in a view, in radii; a closer ball is too large for the view


def ball(steps: int) -> Array:
    """Return the points (3, G) of a cubic grid within the unit ball, with `steps` steps from 0 to 1."""
    axis = np.arange(-steps, steps + 1)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    return np.ascontiguousarray((grid[(grid**2).sum(1) <= steps**2] / steps).T)


BALL = ball(2)


def moved(
    scene: VoteScene, joints: Array, points: Array, view_threshold: float, moving: PointMotion | None = None
) -> NodeProposals:
    """Move points (N, 3) m of joints (N,) to the centres of the votes round them, and return the nodes.

    Each step moves a point to the mean of the points of a ball, weighted by exp((S - S_max) / SOFTNESS) with
    the votes S. The first step has the point's reach as radius, if that exceeds `RADII[0]`. Then follows one
    step for each of `RADII`; the first of these is only for points that few views see. Points without any
    vote near them stay.

    Args:
        moving: Motion of the points between the timestamps of the views; None: they rest.

    Returns:
        the nodes at the instant of the points.
    """
    moving = moving or at_rest(points, scene)
    points = move_to_votes(scene, joints, points, moving, RADII, BALL)
    return NodeProposals(points, joints, *vote_points(scene, joints, points, moving, view_threshold))


class _Line(NamedTuple):
    """Linear function in a ball: its value in the centre, and its increase to the surface along each axis."""

    middle: float
    x: float
    y: float
    z: float


class _Scratch(NamedTuple):
    """Work arrays: the lanes, and rows of one number for each point of the ball."""

    lanes: Array
    rows: Array


@njit(cache=True, error_model="numpy", nogil=True)
def move_to_votes(scene, joints, starts, moving, radii, ball):
    """Return the moved points (N, 3) m of the joints (N,); see `moved`.

    Each view is evaluated at the points' positions at its own timestamp. Votes are means over the views that
    see the position. The ball points lie along the axes of the nearest camera that sees the start. So the
    result does not depend on the world frame.

    Args:
        starts: (N, 3) m.
        radii: m, radii of the balls.
        ball: (3, G) points of the unit ball.
    """
    places, scratch = starts.copy(), _Scratch(np.zeros(SIZE), np.zeros(ROWS))
    for g in range(ball.shape[1]):
        for axis in range(3):
            scratch.rows[axis * POINTS + g] = ball[axis, g]
    for n in range(len(starts)):
        nearest, seeing = _nearest_view(scene, places, n, scratch.lanes)
        if seeing > 0 and moving.reach[n] > radii[0]:
            _step(scene, joints[n], (places, n, moving), nearest, moving.reach[n], ball.shape[1], scratch)
        for m in range(1 if seeing >= MANY_VIEWS else 0, len(radii) if seeing > 0 else 0):
            _step(scene, joints[n], (places, n, moving), nearest, radii[m], ball.shape[1], scratch)
    return places


@inlined
def _nearest_view(scene, places, n, lanes):
    """Return the view that sees a point at the smallest depth, and the number of views that see it."""
    nearest, least, seeing = 0, np.inf, 0
    for c in range(LANES):
        place(lanes, c, places[n, 0], places[n, 1], places[n, 2])
    for v in range(len(scene.cameras)):
        see(scene.cameras, scene.limits, v, lanes)
        if lanes[COVERED] > 0.0:
            seeing += 1
            if lanes[DEPTH] < least:
                nearest, least = v, lanes[DEPTH]
    return nearest, seeing


@inlined
def _step(scene, joint, at, nearest, radius, count, scratch):
    """Move places[n] by one step, in place, with `count` points of the ball; `at` is (places, n, moving)."""
    places, n, moving = at
    camera = scene.cameras[nearest]
    placed = np.inf  # delay of the view for which the lanes hold the ball
    for g in range(POINTS):
        scratch.rows[VOTES + g] = 0.0
    covering = np.int64(0)  # not a literal, which would be a type of its own in numba
    for v in range(len(scene.cameras)):
        if moving.delays[v] != placed:
            placed = moving.delays[v]
            _place_ball(
                camera,
                places[n, 0] + placed * moving.velocities[n, 0],
                places[n, 1] + placed * moving.velocities[n, 1],
                places[n, 2] + placed * moving.velocities[n, 2],
                radius,
                scratch.lanes,
            )
        see(scene.cameras, scene.limits, v, scratch.lanes)
        if scratch.lanes[COVERED] > 0.0 and scratch.lanes[DEPTH] > CLOSE * radius:
            covering += 1
            if scene.map_start[v, joint] < 0:
                _add_keypoints(scene, v, joint, scratch)
            elif _near_patch(scene, v, joint, scratch.lanes):
                _add_map(scene, v, joint, count, scratch)
    x, y, z = _mean(count, covering, scratch.rows)
    x, y, z = radius * x, radius * y, radius * z
    places[n, 0] += camera.r00 * x + camera.r10 * y + camera.r20 * z
    places[n, 1] += camera.r01 * x + camera.r11 * y + camera.r21 * z
    places[n, 2] += camera.r02 * x + camera.r12 * y + camera.r22 * z


@inlined
def _place_ball(camera, x, y, z, radius, lanes):
    """Write ball points to the lanes: 0 and 7 the centre, 1 to 6 the surface along a camera's axes."""
    place(lanes, 0, x, y, z)
    place(lanes, 7, x, y, z)
    for side in range(2):
        r = radius if side == 0 else -radius
        place(lanes, 1 + side, x + r * camera.r00, y + r * camera.r01, z + r * camera.r02)
        place(lanes, 3 + side, x + r * camera.r10, y + r * camera.r11, z + r * camera.r12)
        place(lanes, 5 + side, x + r * camera.r20, y + r * camera.r21, z + r * camera.r22)


@inlined
def _near_patch(scene, v, joint, lanes):
    """Return whether a patch of a view and joint has a cell that a sample in the ball may read."""
    wide_a, wide_b = 1.0, 1.0
    for axis in range(3):
        c, k = 1 + 2 * axis, 2 + 2 * axis
        wide_a += max(abs(lanes[A + c] - lanes[A]), abs(lanes[A + k] - lanes[A]))
        wide_b += max(abs(lanes[B + c] - lanes[B]), abs(lanes[B + k] - lanes[B]))
    table, key = scene.patch_table, v * scene.map_start.shape[1] + joint
    near = False
    for k in range(scene.patch_start[key], scene.patch_start[key + 1]):
        column, row = table[k, 1], table[k, 2]
        beside = lanes[A] - wide_a < column + table[k, 3] and lanes[A] + wide_a >= column
        near = near or (beside and lanes[B] - wide_b < row + table[k, 4] and lanes[B] + wide_b >= row)
    return near


@inlined
def _add_map(scene, v, joint, count, scratch):
    """Add bilinear samples of a view's map to the votes of `count` points."""
    lanes, rows, camera = scratch.lanes, scratch.rows, scene.cameras[v]
    depth, a, b = _line(lanes, DEPTH), _per_depth(lanes, A), _per_depth(lanes, B)
    columns, height, around, first = camera.columns, camera.rows, strides(camera), scene.map_start[v, joint]
    for g in range(POINTS):
        x, y, z = rows[BALL_X + g], rows[BALL_Y + g], rows[BALL_Z + g]
        scale = 1.0 / _at(depth, x, y, z)
        cell, right, below = locate(columns, height, scale * _at(a, x, y, z), scale * _at(b, x, y, z))
        rows[CELLS + g], rows[RIGHTS + g], rows[BELOWS + g] = cell, right, below
    for g in range(count):
        rows[VOTES + g] += sample(
            scene.map_data, first, around, rows[CELLS + g], rows[RIGHTS + g], rows[BELOWS + g]
        )


@inlined
def _add_keypoints(scene, v, joint, scratch):
    """Add the largest Gaussian of a view's 2D joints to the votes."""
    lanes, rows = scratch.lanes, scratch.rows
    reach, middle_u, middle_w = 0.0, lanes[U], lanes[W]
    for c in range(1, 7):
        reach = max(reach, math.hypot(lanes[U + c] - middle_u, lanes[W + c] - middle_w))
    depth, u, w = _line(lanes, DEPTH), _per_depth(lanes, U), _per_depth(lanes, W)
    for g in range(POINTS):
        rows[SCORES + g] = 0.0
    for i in range(scene.people.shape[2]):
        away = math.hypot(scene.people[v, joint, i, 0] - middle_u, scene.people[v, joint, i, 1] - middle_w)
        if away < WIDEST * reach + math.sqrt(GAUSSIAN_END / scene.people[v, joint, i, 2]):  # False if missing
            for g in range(POINTS):
                x, y, z = rows[BALL_X + g], rows[BALL_Y + g], rows[BALL_Z + g]
                scale = 1.0 / _at(depth, x, y, z)
                value = gaussian(scene.people, v, joint, i, scale * _at(u, x, y, z), scale * _at(w, x, y, z))
                rows[SCORES + g] = max(rows[SCORES + g], value)
    for g in range(POINTS):
        rows[VOTES + g] += rows[SCORES + g]


@inlined
def _line(lanes, row):
    """Return a row of the lanes as a linear function in the ball."""
    return _Line(
        lanes[row],
        0.5 * (lanes[row + 1] - lanes[row + 2]),
        0.5 * (lanes[row + 3] - lanes[row + 4]),
        0.5 * (lanes[row + 5] - lanes[row + 6]),
    )


@inlined
def _per_depth(lanes, row):
    """Return a row times depth as a linear function in the ball; it is exact without lens distortion.

    The row itself is multiplied by the depth.
    """
    for c in range(LANES):
        lanes[row + c] *= lanes[DEPTH + c]
    return _line(lanes, row)


@inlined
def _at(line, x, y, z):
    """Return the value of a linear function at a point of the unit ball."""
    return line.middle + line.x * x + line.y * y + line.z * z


@inlined
def _mean(count, covering, rows):
    """Return the mean of `count` points of the unit ball, weighted by their votes of `covering` views."""
    best = 0.0
    for g in range(count):
        best = max(best, rows[VOTES + g])
    rate = 1.0 / (SOFTNESS * max(covering, 1))
    for g in range(POINTS):
        rows[WEIGHTS + g] = _decay((best - rows[VOTES + g]) * rate)
    total, x, y, z = 0.0, 0.0, 0.0, 0.0
    for g in range(count if best > 0.0 else 0):
        weight = rows[WEIGHTS + g]
        total += weight
        x += weight * rows[BALL_X + g]
        y += weight * rows[BALL_Y + g]
        z += weight * rows[BALL_Z + g]
    total = max(total, 1e-300)
    return x / total, y / total, z / total


@inlined
def _decay(x):
    """Return exp(-x) for x >= 0, 0 from 12 on; relative error below 1e-5.

    It has no calls, so that compilers can vectorise it.
    """
    part = min(x, 12.0) / 64.0
    value = 1.0 - part * (1.0 - part * (0.5 - part * (1.0 / 6.0 - part / 24.0)))
    value *= value
    value *= value
    value *= value
    value *= value
    value *= value
    value *= value
    return value if x < 12.0 else 0.0
