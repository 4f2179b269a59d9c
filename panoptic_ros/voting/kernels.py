"""Compiled kernels of voting. `score_field`, `score_volume` and the tests hold the numpy meaning.

All that sample scores are in one file. `scene` is a `VoteScene`; its sums run over the views in order.
"""
from __future__ import annotations

import math

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.solving.lens_kernels import fisheye_factor
from panoptic_ros.voting.score_field import GAUSSIAN_END

MIN_DEPTH = 1e-3  # m, as in the pinhole camera of `geometry`
KEY_BITS = 21  # of a voxel's index per axis
KEY_HALF = 1 << (KEY_BITS - 1)
HASH = -7046029254386353131  # odd, with well mixed bits

_jit = njit(cache=True, error_model="numpy", nogil=True)


@_jit
def project(cameras, v, x, y, z):
    """Pixel (u, w), cell (a, b) of a world point in view v, and whether the view covers it."""
    camera = cameras[v]
    depth = camera.r20 * x + camera.r21 * y + camera.r22 * z + camera.tz
    if depth <= MIN_DEPTH:
        return 0.0, 0.0, 0.0, 0.0, False
    px = (camera.r00 * x + camera.r01 * y + camera.r02 * z + camera.tx) / depth
    py = (camera.r10 * x + camera.r11 * y + camera.r12 * z + camera.ty) / depth
    r2 = px * px + py * py
    if not r2 < camera.fold:
        return 0.0, 0.0, 0.0, 0.0, False
    p1, p2 = camera.p1, camera.p2
    if camera.fisheye > 0.0:
        radial = fisheye_factor(camera.k1, camera.k2, camera.k3, camera.k4, r2)
    else:
        radial = 1.0 + r2 * (camera.k1 + r2 * (camera.k2 + r2 * camera.k3))
    dx = px * radial + 2.0 * p1 * px * py + p2 * (r2 + 2.0 * px * px)
    dy = py * radial + p1 * (r2 + 2.0 * py * py) + 2.0 * p2 * px * py
    u = camera.fx * dx + camera.skew * dy + camera.cx
    w = camera.fy * dy + camera.cy
    if not (-0.5 <= u <= camera.width - 0.5 and -0.5 <= w <= camera.height - 0.5):
        return u, w, 0.0, 0.0, False
    if camera.columns == 0.0:
        return u, w, 0.0, 0.0, True
    a = camera.a0 * u + camera.a1 * w + camera.a2
    b = camera.b0 * u + camera.b1 * w + camera.b2
    return u, w, a, b, -0.5 <= a <= camera.columns - 0.5 and -0.5 <= b <= camera.rows - 0.5


@_jit
def hidden(cameras, limits, v, x, y, z, u, w):
    """Whether a world point at pixel (u, w) of view v lies beyond the view's limit."""
    start = int(limits[3 * v])
    if start == 0:
        return False
    camera, columns, rows = cameras[v], int(limits[3 * v + 1]), int(limits[3 * v + 2])
    i = min(int((u + 0.5) * (columns / camera.width)), columns - 1)
    k = min(int((w + 0.5) * (rows / camera.height)), rows - 1)
    depth = camera.r20 * x + camera.r21 * y + camera.r22 * z + camera.tz
    return depth > limits[start + k * columns + i]


@_jit
def _corner(at, size):
    """Lower and upper cell, and the upper one's weight, for a bilinear sample clamped to the grid."""
    at = min(max(at, 0.0), size - 1.0)
    low = min(int(at), max(size - 2, 0))
    return low, min(low + 1, size - 1), at - low


@_jit
def sample_map(cameras, v, start, data, a, b):
    """Merged map of view v that begins at `start`, at a cell."""
    camera = cameras[v]
    width = int(camera.columns)
    x0, x1, fx = _corner(a, width)
    y0, y1, fy = _corner(b, int(camera.rows))
    top = data[start + y0 * width + x0] * (1.0 - fx) + data[start + y0 * width + x1] * fx
    bottom = data[start + y1 * width + x0] * (1.0 - fx) + data[start + y1 * width + x1] * fx
    return (top * (1.0 - fy) + bottom * fy) / 255.0


@_jit
def sample_keypoint(people, v, j, i, u, w):
    """Gaussian of joint j of 2D person i in view v at a pixel; 0 if the joint is missing."""
    dx, dy = people[v, j, i, 0] - u, people[v, j, i, 1] - w
    exponent = (dx * dx + dy * dy) * people[v, j, i, 2]
    return people[v, j, i, 3] * math.exp(-exponent) if exponent < GAUSSIAN_END else 0.0


@_jit
def vote(cameras, limits, people, map_start, map_data, j, x, y, z, view_threshold):
    """Eq. 1 at a point: the mean over the views that see it, and how many support it."""
    total, covering, support = 0.0, 0, 0
    for v in range(len(cameras)):
        u, w, a, b, covered = project(cameras, v, x, y, z)
        if not covered or hidden(cameras, limits, v, x, y, z, u, w):
            continue
        start = map_start[v, j]
        score = 0.0
        if start >= 0:
            score = sample_map(cameras, v, start, map_data, a, b)
        else:
            for i in range(people.shape[2]):
                score = max(score, sample_keypoint(people, v, j, i, u, w))
        covering += 1
        total += score
        support += score > view_threshold
    return (total / covering if covering else 0.0), support


@_jit
def vote_points(scene, joints, points, view_threshold):
    """Votes (N,) and supporting views (N,) of points (N, 3) for the joints (N,)."""
    cameras, people, map_start, map_data = scene.cameras, scene.people, scene.map_start, scene.map_data
    limits = scene.limits
    votes = np.zeros(len(points))
    support = np.zeros(len(points), np.int64)
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        votes[n], support[n] = vote(
            cameras, limits, people, map_start, map_data, joints[n], x, y, z, view_threshold
        )
    return votes, support


@_jit
def vote_block(scene, first, shape, voxel, view_threshold):
    """Votes and supporting views (J, nx, ny, nz) at the centres of a block of voxels.

    A projection is shared by all joints.
    """
    cameras, people, map_start, map_data = scene.cameras, scene.people, scene.map_start, scene.map_data
    limits = scene.limits
    nx, ny, nz = shape
    joint_count = map_start.shape[1]
    votes = np.zeros((joint_count, nx, ny, nz))
    support = np.zeros((joint_count, nx, ny, nz), np.int64)
    for cell in range(nx * ny * nz):
        p, q, s = cell // (ny * nz), cell // nz % ny, cell % nz
        x, y, z = _centre(first[0] + p, first[1] + q, first[2] + s, voxel)
        covering = 0
        for v in range(len(cameras)):
            u, w, a, b, covered = project(cameras, v, x, y, z)
            if not covered or hidden(cameras, limits, v, x, y, z, u, w):
                continue
            covering += 1
            for j in range(joint_count):
                score = 0.0
                if map_start[v, j] >= 0:
                    score = sample_map(cameras, v, map_start[v, j], map_data, a, b)
                else:
                    for i in range(people.shape[2]):
                        score = max(score, sample_keypoint(people, v, j, i, u, w))
                votes[j, p, q, s] += score
                support[j, p, q, s] += score > view_threshold
        for j in range(joint_count):
            votes[j, p, q, s] /= max(covering, 1)
    return votes, support


@_jit
def _centre(i, j, k, voxel):
    return (i + 0.5) * voxel, (j + 0.5) * voxel, (k + 0.5) * voxel


@_jit
def _key(i, j, k):
    """One number per voxel; smaller ones come first among equal votes."""
    return ((i + KEY_HALF) << (2 * KEY_BITS)) | ((j + KEY_HALF) << KEY_BITS) | (k + KEY_HALF)


@_jit
def _slot(key, epoch, keys, epochs):
    """Where a key is in the hash table, or would be put."""
    mask = len(keys) - 1
    slot = ((key * HASH) >> 24) & mask
    while epochs[slot] == epoch and keys[slot] != key:
        slot = (slot + 1) & mask
    return slot


@_jit
def climb(scene, joints, voxels, lower, upper, voxel, view_threshold, eligible, keys, epochs, ranks):
    """Steepest ascent from voxels (S, 3) for joints (S,), in order of joint, to local maxima (S, 3).

    What it climbs is the vote at the voxel's centre, plus 2 if `eligible` views support it; also returned
    (S,). That is 0 where there is nothing to climb, and for voxels that an earlier ascent has looked at:
    it went higher. Stays within the voxels lower <= index < upper. The last three arrays, of one size, a
    power of two, are the memory of votes: a hash table whose entries of earlier epochs count as empty.
    """
    cameras, people, map_start, map_data = scene.cameras, scene.people, scene.map_start, scene.map_data
    limits = scene.limits
    tops = voxels.copy()
    heights = np.zeros(len(voxels))
    epoch, remembered = 0, 0
    for s in range(len(voxels)):
        joint = joints[s]
        if s == 0 or joint != joints[s - 1] or remembered > len(keys) // 2:
            epoch += 1
            remembered = 0
        i, j, k = tops[s, 0], tops[s, 1], tops[s, 2]
        if epochs[_slot(_key(i, j, k), epoch, keys, epochs)] == epoch:
            continue
        best = -1.0
        while True:
            ci, cj, ck = i, j, k
            for ni in range(max(ci - 1, lower[0]), min(ci + 2, upper[0])):
                for nj in range(max(cj - 1, lower[1]), min(cj + 2, upper[1])):
                    for nk in range(max(ck - 1, lower[2]), min(ck + 2, upper[2])):
                        key = _key(ni, nj, nk)
                        slot = _slot(key, epoch, keys, epochs)
                        if epochs[slot] != epoch:
                            x, y, z = _centre(ni, nj, nk, voxel)
                            score, support = vote(
                                cameras, limits, people, map_start, map_data, joint, x, y, z,
                                view_threshold,
                            )
                            keys[slot], epochs[slot] = key, epoch
                            ranks[slot] = score + (2.0 if support >= eligible else 0.0)
                            remembered += 1
                        rank = ranks[slot]
                        if rank > best or (rank == best and rank > 0.0 and key < _key(i, j, k)):
                            best, i, j, k = rank, ni, nj, nk
            if best <= 0.0 or (i == ci and j == cj and k == ck):
                break
        tops[s, 0], tops[s, 1], tops[s, 2] = i, j, k
        heights[s] = max(best, 0.0)
    return tops, heights


@_jit
def person_scores(scene, joints, points):
    """Scores h_ij (N, V, P) of points (N, 3) for the joints (N,), and which views see them (N, V)."""
    cameras, people, map_start, limits = scene.cameras, scene.people, scene.map_start, scene.limits
    gates, patch_start, patch_table, patch_data = (
        scene.gates, scene.patch_start, scene.patch_table, scene.patch_data
    )  # fmt: skip
    views, joint_count, most = len(cameras), map_start.shape[1], people.shape[2]
    scores = np.zeros((len(points), views, most))
    seen = np.zeros((len(points), views), np.bool_)
    corners = np.zeros((most + 1, 4))
    for n in range(len(points)):
        j = joints[n]
        for v in range(views):
            px, py, pz = points[n, 0], points[n, 1], points[n, 2]
            u, w, a, b, covered = project(cameras, v, px, py, pz)
            if not covered or hidden(cameras, limits, v, px, py, pz, u, w):
                continue
            seen[n, v] = True
            if map_start[v, j] < 0:
                for i in range(most):
                    scores[n, v, i] = sample_keypoint(people, v, j, i, u, w)
                continue
            first, last = patch_start[v * joint_count + j], patch_start[v * joint_count + j + 1]
            x, y, some = _patch_corners(cameras, v, patch_table, patch_data, first, last, a, b, corners)
            if not some:
                continue
            for i in range(most):
                dx, dy = people[v, j, i, 0] - u, people[v, j, i, 1] - w
                near = dx * dx + dy * dy <= gates[v, i]
                for c in range(4):
                    if near:
                        corners[i, c] = max(corners[i, c], corners[most, c])
                top = corners[i, 0] * (1.0 - x) + corners[i, 1] * x
                bottom = corners[i, 2] * (1.0 - x) + corners[i, 3] * x
                scores[n, v, i] = (top * (1.0 - y) + bottom * y) / 255.0
    return scores, seen


@_jit
def _patch_corners(cameras, v, patch_table, patch_data, first, last, a, b, corners):
    """What patches first..last hold in the four cells about a cell: (P + 1, 4), for each person and for all.

    Returns the weights of the upper cells, and whether there is anything.
    """
    camera = cameras[v]
    x0, x1, fx = _corner(a, int(camera.columns))
    y0, y1, fy = _corner(b, int(camera.rows))
    some = False
    for k in range(first, last):
        column, row, width, height = patch_table[k, 1:5]
        if x1 < column or x0 >= column + width or y1 < row or y0 >= row + height:
            continue
        if not some:
            corners[:] = 0.0
            some = True
        i = patch_table[k, 0] if patch_table[k, 0] >= 0 else len(corners) - 1
        for c in range(4):
            x = (x1 if c & 1 else x0) - column
            y = (y1 if c & 2 else y0) - row
            if 0 <= x < width and 0 <= y < height:
                corners[i, c] = max(corners[i, c], float(patch_data[patch_table[k, 5] + y * width + x]))
    return fx, fy, some
