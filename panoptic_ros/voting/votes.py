"""Votes (eq. 1 of Joo et al. 2017) of eight points at a time: their projections, and the map scores there.

`lanes` is a flat array of rows of eight numbers, one number for each point. Loops over the points have no
branches, so that compilers can vectorise them. All votes and searches project with `see`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from panoptic_ros.geometry.lens_kernels import bent, bent_by_many
from panoptic_ros.geometry.pinhole import MIN_DEPTH
from panoptic_ros.kernels import inlined, njit
from panoptic_ros.solving.scene import within
from panoptic_ros.voting.scene import VoteScene

Array = np.ndarray
GAUSSIAN_END = 6.0  # half of the squared distance in standard deviations beyond which a Gaussian is 0
LANES = 8
X, Y, Z, DEPTH, U, W, A, B, COVERED, CELL, RIGHT, BELOW = range(0, 96, LANES)
SIZE = 96  # length of an array of lanes
BROWN, FISHEYE, MANY = range(3)  # kinds of lenses: up to five terms, fisheye, up to 14 terms


class PointMotion(NamedTuple):
    """Motion of N points, and the uncertainty of their positions.

    Args:
        velocities: (N, 3) m/s.
        delays: (V,) s, exposure of each view's middle row minus the instant of the points.
        reach: (N,) m, distance from the assumed position within which a point may lie.
    """

    velocities: Array
    delays: Array
    reach: Array


def at_rest(points: Array, scene: VoteScene) -> PointMotion:
    """Return the motion of points (N, 3) at rest, or of views with one timestamp."""
    return PointMotion(np.zeros((len(points), 3)), np.zeros(len(scene.cameras)), np.zeros(len(points)))


@inlined
def place(lanes, c, x, y, z):
    """Set point c to x, y, z, m in the world."""
    lanes[X + c], lanes[Y + c], lanes[Z + c] = x, y, z


@inlined
def see(cameras, limits, v, lanes):
    """Project the points into view v.

    Writes to the lanes:
        DEPTH: depth.
        U, W: pixels.
        A, B: cells of the map.
        COVERED: 1 where the view sees the point, else 0.
        CELL, RIGHT, BELOW: for `sample`, the cell on the upper left, and the distance to its right and below
            it, 0..1.

    Args:
        cameras, limits: as in `VoteScene`.
    """
    if cameras[v].fisheye > 0.0:
        _project(cameras[v], FISHEYE, lanes)
    elif cameras[v].many > 0.0:
        _project_many(cameras[v], lanes)
    else:
        _project(cameras[v], BROWN, lanes)
    for c in range(LANES if limits[3 * v] > 0.0 else 0):
        if lanes[COVERED + c] > 0.0:
            near = within(cameras[v], limits, v, lanes[U + c], lanes[W + c], lanes[DEPTH + c])
            lanes[COVERED + c] = 1.0 if near else 0.0


@njit(cache=True, error_model="numpy", nogil=True, _nrt=False)
def _project_many(camera, lanes):
    """Project through a lens of many terms.

    This is a call, because its code inlined would make all searches larger.
    """
    _project(camera, MANY, lanes)


@inlined
def _project(camera, lens, lanes):
    """Project the points through a lens of one kind.

    The kind is an argument, so that each kind has a loop without branches.
    """
    r00, r01, r02, tx = camera.r00, camera.r01, camera.r02, camera.tx
    r10, r11, r12, ty = camera.r10, camera.r11, camera.r12, camera.ty
    r20, r21, r22, tz = camera.r20, camera.r21, camera.r22, camera.tz
    fx, skew, cx, fy, cy, fold = camera.fx, camera.skew, camera.cx, camera.fy, camera.cy, camera.fold
    terms = (camera.k1, camera.k2, camera.p1, camera.p2, camera.k3, camera.k4)
    a0, a1, a2, b0, b1, b2 = camera.a0, camera.a1, camera.a2, camera.b0, camera.b1, camera.b2
    last_u, last_w, columns, rows = camera.width - 0.5, camera.height - 0.5, camera.columns, camera.rows
    for c in range(LANES):
        x, y, z = lanes[X + c], lanes[Y + c], lanes[Z + c]
        depth = r20 * x + r21 * y + r22 * z + tz
        px, py = (r00 * x + r01 * y + r02 * z + tx) / depth, (r10 * x + r11 * y + r12 * z + ty) / depth
        dx, dy, r2 = bent_by_many(camera, px, py) if lens == MANY else bent(terms, lens == FISHEYE, px, py)
        u, w = fx * dx + skew * dy + cx, fy * dy + cy
        a, b = a0 * u + a1 * w + a2, b0 * u + b1 * w + b2
        seen = (depth > MIN_DEPTH) & (r2 < fold) & (-0.5 <= u) & (u <= last_u) & (-0.5 <= w) & (w <= last_w)
        mapped = (-0.5 <= a) & (a <= columns - 0.5) & (-0.5 <= b) & (b <= rows - 0.5)
        lanes[DEPTH + c], lanes[U + c], lanes[W + c], lanes[A + c], lanes[B + c] = depth, u, w, a, b
        lanes[COVERED + c] = 1.0 if seen & (mapped | (columns == 0.0)) else 0.0
        cell, right, below = locate(columns, rows, a if seen else 0.0, b if seen else 0.0)
        lanes[CELL + c], lanes[RIGHT + c], lanes[BELOW + c] = cell, right, below


@inlined
def locate(columns, rows, a, b):
    """Return the cell on the upper left of a map position, and the distance to its right and below.

    The distances are in cells, 0..1.
    """
    a, b = min(max(a, 0.0), max(columns - 1.0, 0.0)), min(max(b, 0.0), max(rows - 1.0, 0.0))
    left, top = np.floor(min(a, max(columns - 2.0, 0.0))), np.floor(min(b, max(rows - 2.0, 0.0)))
    return top * columns + left, a - left, b - top


@inlined
def strides(camera):
    """Return the index steps in a map to the cells on the right and below; 0 if it has one column or row."""
    return int(camera.columns > 1.0), int(camera.columns) if camera.rows > 1.0 else 0


@inlined
def sample(data, first, strides, cell, x, y):
    """Return a bilinear sample, 0..1, of the map that begins at data[first].

    Args:
        x, y: Distance to the right of the cell and below it, 0..1.
    """
    right, below = strides
    at = first + int(cell)
    top = data[at] * (1.0 - x) + data[at + right] * x
    bottom = data[at + below] * (1.0 - x) + data[at + below + right] * x
    return (top * (1.0 - y) + bottom * y) / 255.0


@inlined
def gaussian(people, v, j, i, u, w):
    """Return the Gaussian of joint j of 2D pose i in view v at a pixel; 0 if the joint is missing.

    See `VoteScene.people`.
    """
    dx, dy = people[v, j, i, 0] - u, people[v, j, i, 1] - w
    exponent = (dx * dx + dy * dy) * people[v, j, i, 2]
    return people[v, j, i, 3] * math.exp(-exponent) if exponent < GAUSSIAN_END else 0.0


@inlined
def score(scene, v, joint, strides, lanes, c):
    """Return h_j of view v at point c, which the view sees: from its map, or else from its 2D joints."""
    first = scene.map_start[v, joint]
    if first >= 0:
        return sample(scene.map_data, first, strides, lanes[CELL + c], lanes[RIGHT + c], lanes[BELOW + c])
    best = 0.0
    for i in range(scene.people.shape[2]):
        best = max(best, gaussian(scene.people, v, joint, i, lanes[U + c], lanes[W + c]))
    return best


@njit(cache=True, error_model="numpy", nogil=True)
def vote_points(scene, joints, points, moving, view_threshold):
    """Compute eq. 1 at points (N, 3) m for the joints (N,).

    It is the mean over the views that see a point, at its position at the view's timestamp.

    Returns:
        votes (N,), and the number (N,) of views with scores above the threshold.
    """
    votes, support = np.zeros(len(points)), np.zeros(len(points), np.int64)
    seeing, lanes = np.zeros(len(points)), np.zeros(SIZE)
    for first in range(0, len(points), LANES):
        count = min(LANES, len(points) - first)
        for v in range(len(scene.cameras)):
            late, around = moving.delays[v], strides(scene.cameras[v])
            for c in range(LANES):
                n = first + min(c, count - 1)
                place(
                    lanes,
                    c,
                    points[n, 0] + late * moving.velocities[n, 0],
                    points[n, 1] + late * moving.velocities[n, 1],
                    points[n, 2] + late * moving.velocities[n, 2],
                )
            see(scene.cameras, scene.limits, v, lanes)
            for c in range(count):
                if lanes[COVERED + c] > 0.0:
                    value = score(scene, v, joints[first + c], around, lanes, c)
                    votes[first + c] += value
                    seeing[first + c] += 1.0
                    support[first + c] += value > view_threshold
    return votes / np.maximum(seeing, 1.0), support
