"""Exact search: local maxima of eq. 1 at the centres of all voxels, without visiting empty space.

A view can vote for a joint only within cones of viewing rays round its patches and 2D joints. The search
skips boxes of voxels that the cones of too few views touch, and computes the vote of every voxel in the
others.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain.of_all import selected
from panoptic_ros.kernels import njit
from panoptic_ros.voting.proposals import NodeCriteria, NodeProposals
from panoptic_ros.voting.scene import VoteScene
from panoptic_ros.voting.seeds import pixel_rays
from panoptic_ros.voting.volume import Volume
from panoptic_ros.voting.votes import COVERED, GAUSSIAN_END, LANES, SIZE, place, score, see, strides

Array = np.ndarray
STEPS = sorted(np.ndindex(3, 3, 3), key=lambda step: sum(axis != 1 for axis in step))[1:]  # few axes first
TILE = 4  # cells of a score map, across and down, that share one cone
# on a rectangle's border
RIM = np.array([[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [1, 2], [0, 2], [0, 1]]) / 2.0
BULGE = 0.25  # greatest bend by a lens of the edge between two border points, as a share of their distance
WIDEST = 1.5  # rad, greatest half angle of a cone
ROUNDING = 1e-6  # rad, margin for rounding errors
MARGIN = 1e-9  # m, more than rounding errors
LARGEST, SPLIT = 32, 2  # voxels per side of the first boxes; parts of a split side (down to 2 voxels)

_jit = njit(cache=True, error_model="numpy", nogil=True)


class Cones(NamedTuple):
    """Cones (N,) in the order of views and joints.

    Args:
        views, joints: (N,) view and joint of each cone.
        axes: (N, 3) unit vectors in the world.
        cosines, sines: (N,) of the half angle. A cosine below -1 marks a cone without limit: it contains any
            point.
    """

    views: Array
    joints: Array
    axes: Array
    cosines: Array
    sines: Array


def maxima(scene: VoteScene, volume: Volume, wanted: NodeCriteria) -> NodeProposals:
    """Return nodes at the centres of all local maxima, in the order of joint and voxel.

    A maximum is a voxel that satisfies the demands and wins against its 26 neighbours. A neighbour that
    satisfies the demands beats it with more votes, or with equal votes and an earlier position in the order.
    """
    found = visit(scene, cones_of(scene), volume, wanted)
    at = found[:, :4].astype(np.int64)
    top = highest(at - (0, *volume.lower), found[:, 5])
    nodes = NodeProposals(volume.centres(at[:, 1:]), at[:, 0], found[:, 5], found[:, 4].astype(np.int64))
    return selected(nodes, top)


def highest(at: Array, votes: Array) -> Array:
    """Return the indices of joints and voxels (N, 4) that are local maxima, in their order.

    A maximum has no neighbour of its joint with more votes, or with equal votes and an earlier position. All
    indices start from 0.
    """
    shape = at.max(axis=0, initial=0) + 3  # padding, so that voxels on opposite sides are not neighbours
    keys = np.ravel_multi_index(tuple(at.T), shape)
    order = np.argsort(keys)
    keys, votes, left = keys[order], votes[order], np.arange(len(keys))
    for step in STEPS:  # most voxels lose against one of the first neighbours
        move = int(np.dot(np.array(step) - 1, [shape[2] * shape[3], shape[3], 1]))
        other = np.minimum(np.searchsorted(keys, keys[left] + move), len(keys) - 1)
        more = votes[other] - votes[left]
        beaten = (keys[other] == keys[left] + move) & ((more > 0.0) | ((more == 0.0) & (move < 0)))
        left = left[~beaten]
    return order[left]


def cones_of(scene: VoteScene) -> Cones:
    """Return cones that contain all places with a score above 0.

    A lens with tangential terms may map a place farther than about 80 degrees off its axis into the image a
    second time. The cones do not contain such second images, which no real lens has.
    """
    views, joints, low, high = (np.concatenate(p) for p in zip(_of_keypoints(scene), _of_patches(scene)))
    last = np.stack([scene.cameras["width"], scene.cameras["height"]], -1)[views] - 0.5
    low, high = np.maximum(low, -0.5), np.minimum(high, last)
    order = np.lexsort([joints, views])
    order = order[(low <= high).all(1)[order]]
    views, joints, low, high = views[order], joints[order], low[order], high[order]
    rim = low[:, None] + RIM * (high - low)[:, None]
    rays = pixel_rays(scene.cameras, np.repeat(views, len(RIM)), rim.reshape(-1, 2))
    rays = rays.reshape(*rim.shape[:2], 3)
    axes = rays.sum(1)
    axes /= np.maximum(np.linalg.norm(axes, axis=-1, keepdims=True), 1e-300)
    steps = _angles(rays, np.roll(rays, 1, axis=1)).max(1)
    half = _angles(rays, axes[:, None]).max(1) + BULGE * steps + ROUNDING
    known = half < WIDEST  # False where the lens has no ray for a part of the border
    return Cones(views, joints, axes, np.where(known, np.cos(half), -2.0), np.where(known, np.sin(half), 0.0))


def _angles(ones: Array, others: Array) -> Array:
    """Return the angles (N, K) between unit vectors (N, K, 3)."""
    angles: Array = 2.0 * np.arcsin(np.minimum(0.5 * np.linalg.norm(ones - others, axis=-1), 1.0))
    return angles


def _of_keypoints(scene: VoteScene) -> tuple[Array, ...]:
    """Return views, joints (N,), least and largest pixels (N, 2) of Gaussians, for joints without maps."""
    people = scene.people
    views, joints, persons = np.nonzero((people[..., 3] > 0.0) & (scene.map_start < 0)[..., None])
    points, narrowness = people[views, joints, persons, :2], people[views, joints, persons, 2:3]
    reach = np.sqrt(GAUSSIAN_END / narrowness)
    return views, joints, points - reach, points + reach


def _of_patches(scene: VoteScene) -> tuple[Array, ...]:
    """Return the same as `_of_keypoints` for tiles of patches with any value above 0.

    The pixels include one further cell on each side, which bilinear samples read.
    """
    key = np.repeat(np.arange(len(scene.patch_start) - 1), np.diff(scene.patch_start))
    corners, sizes = scene.patch_table[:, 1:3], scene.patch_table[:, 3:5]
    across = -(-sizes // TILE)  # number of tiles
    mine, at = _cells(across)
    patch, place = _cells(sizes)
    first = np.cumsum(across.prod(1)) - across.prod(1)
    some = np.zeros(len(mine), bool)
    filled = scene.patch_data[scene.patch_table[patch, 5] + place[:, 1] * sizes[patch, 0] + place[:, 0]] > 0
    some[(first[patch] + place[:, 1] // TILE * across[patch, 0] + place[:, 0] // TILE)[filled]] = True
    mine, at = mine[some], at[some]
    low = corners[mine] + TILE * at - 1.0
    high = np.minimum(low + TILE + 1.0, corners[mine] + sizes[mine])
    views, joints = np.divmod(key[mine], scene.map_start.shape[1])
    cameras, rim = scene.cameras[views], low[:, None] + RIM[::2] * (high - low)[:, None]
    a, b = rim[..., 0] - cameras["a2"][:, None], rim[..., 1] - cameras["b2"][:, None]
    a0, a1, b0, b1 = (cameras[name][:, None] for name in ("a0", "a1", "b0", "b1"))
    det = a0 * b1 - a1 * b0
    places = np.stack([(b1 * a - a1 * b) / det, (a0 * b - b0 * a) / det], -1)
    return views, joints, places.min(1), places.max(1)


def _cells(sizes: Array) -> tuple[Array, Array]:
    """Return all cells of grids of columns and rows (K, 2): their grid (C,), and column and row (C, 2)."""
    counts = sizes.prod(1)
    grid = np.repeat(np.arange(len(sizes)), counts)
    at = np.arange(len(grid)) - (np.cumsum(counts) - counts)[grid]
    return grid, np.stack([at % sizes[grid, 0], at // sizes[grid, 0]], -1)


class _Votes(NamedTuple):
    """Work arrays of the search, for J joints, N cones and the eight voxels of a smallest box.

    Args:
        last: (J,) last view that counted.
        possible: (J,) number of views that may see the joint in a box.
        touching: (N,) indices of the cones that touch a box.
        sums: (J, 8) sums of the scores of each voxel.
        support: (J, 8) number of supporting views of each voxel.
        covering: (8,) number of views that see each voxel.
        lanes: See `votes`.
    """

    last: Array
    possible: Array
    touching: Array
    sums: Array
    support: Array
    covering: Array
    lanes: Array


@_jit
def visit(scene, cones, volume, wanted):
    """Return all voxels with votes above the threshold and at least `wanted.min_views` supporting views.

    A box is tested only with the cones that touch the larger box that contains it.

    Args:
        scene: `VoteScene`.
        cones: `Cones`.
        volume: `Volume`.
        wanted: `NodeCriteria`.

    Returns:
        found (N, 6): joint, voxel (3 indices), number of supporting views, vote as in `vote_points`.
    """
    joints, (lower, upper, unit) = scene.map_start.shape[1], volume
    votes = _Votes(
        np.zeros(joints, np.int64),
        np.zeros(joints, np.int64),
        np.zeros(len(cones.views), np.int64),
        np.zeros((joints, LANES)),
        np.zeros((joints, LANES), np.int64),
        np.zeros(LANES),
        np.zeros(SIZE),
    )
    found, total = np.empty((1024, 6)), 0
    boxes = [(lower, LARGEST, np.arange(len(cones.views)))]
    for corner in _corners(lower, upper, LARGEST)[1:]:
        boxes.append((corner, LARGEST, boxes[0][2]))
    while len(boxes):
        corner, side, near = boxes.pop()
        near = _touching(scene, cones, near, (corner, side, unit), wanted.min_views, votes)
        if len(near) and side > 2:
            x, y, z = corner
            ends = (min(x + side, upper[0]), min(y + side, upper[1]), min(z + side, upper[2]))
            for inner in _corners(corner, ends, side // SPLIT):
                boxes.append((inner, side // SPLIT, near))
        elif len(near):
            if total + LANES * joints > len(found):
                found = np.concatenate((found, np.empty((len(found) + LANES * joints, 6))))
            _vote(scene, cones, near, corner, unit, wanted, votes)
            total = _write(votes, corner, upper, wanted, found, total)
    return found[:total]


@_jit
def _corners(lower, upper, step):
    """Return the first voxels of boxes with `step` voxels a side."""
    return [
        (x, y, z)
        for x in range(lower[0], upper[0], step)
        for y in range(lower[1], upper[1], step)
        for z in range(lower[2], upper[2], step)
    ]


@_jit
def _touching(scene, cones, near, box, least, votes):
    """Return those of the cones `near` that touch the ball round a box, for joints with enough views.

    A joint needs touching cones of at least `least` views.
    """
    last, possible, touching = votes.last, votes.possible, votes.touching
    corner, side, unit = box
    half = 0.5 * side
    x, y, z = (corner[0] + half) * unit, (corner[1] + half) * unit, (corner[2] + half) * unit
    radius = math.sqrt(3.0) * (half - 0.5) * unit + MARGIN
    for m in range(len(last)):
        last[m], possible[m] = -1, 0
    count, view, dx, dy, dz, tangent = 0, -1, 0.0, 0.0, 0.0, 0.0
    for n in near:
        v, m = cones.views[n], cones.joints[n]
        if v != view:
            view = v
            dx, dy, dz = x - scene.cameras[v].ox, y - scene.cameras[v].oy, z - scene.cameras[v].oz
            tangent = math.sqrt(max(dx * dx + dy * dy + dz * dz - radius * radius, 0.0))
        along = dx * cones.axes[n, 0] + dy * cones.axes[n, 1] + dz * cones.axes[n, 2]
        inside = along >= cones.cosines[n] * tangent - cones.sines[n] * radius
        if inside or tangent == 0.0 or cones.cosines[n] < -1.0:  # 0: the view is within the ball
            touching[count] = n
            count += 1
            possible[m] += last[m] != v
            last[m] = v
    kept = 0
    for k in range(count):
        if possible[cones.joints[touching[k]]] >= max(least, 1):
            touching[kept] = touching[k]
            kept += 1
    return touching[:kept].copy()


@_jit
def _vote(scene, cones, near, corner, unit, wanted, votes):
    """Compute eq. 1 at the voxels of one of the smallest boxes: sums, covering and support."""
    last, _, _, sums, support, covering, lanes = votes
    last[:] = -1
    covering[:] = 0.0
    for c in range(LANES):
        i, j, k = corner[0] + (c >> 2), corner[1] + (c >> 1 & 1), corner[2] + (c & 1)
        place(lanes, c, (i + 0.5) * unit, (j + 0.5) * unit, (k + 0.5) * unit)
    view = -1
    for n in near:
        v, m = cones.views[n], cones.joints[n]
        if last[m] < 0:
            sums[m], support[m] = 0.0, 0
        elif last[m] == v:
            continue
        last[m] = v
        if v != view:
            see(scene.cameras, scene.limits, v, lanes)
            view = v
        around = strides(scene.cameras[v])
        for c in range(LANES):
            if lanes[COVERED + c] > 0.0:
                value = score(scene, v, m, around, lanes, c)
                sums[m, c] += value
                support[m, c] += value > wanted.view_threshold
    best = 0.0
    for m in range(len(last)):
        for c in range(LANES if last[m] >= 0 else 0):
            if support[m, c] >= wanted.min_views:
                best = max(best, sums[m, c])
    for v in range(len(scene.cameras)):
        if covering.min() * wanted.threshold > best or best == 0.0:  # no vote can exceed the threshold now
            break
        see(scene.cameras, scene.limits, v, lanes)
        for c in range(LANES):
            covering[c] += lanes[COVERED + c]


@_jit
def _write(votes, corner, upper, wanted, found, total):
    """Write the wanted voxels of a box to found[total] and on; return the new total."""
    for m in range(len(votes.last)):
        for c in range(LANES if votes.last[m] >= 0 else 0):
            vote = votes.sums[m, c] / max(votes.covering[c], 1.0)
            a, b, d = corner[0] + (c >> 2), corner[1] + (c >> 1 & 1), corner[2] + (c & 1)
            good = vote > wanted.threshold and votes.support[m, c] >= wanted.min_views
            if good and a < upper[0] and b < upper[1] and d < upper[2]:
                found[total, 0], found[total, 1], found[total, 2], found[total, 3] = m, a, b, d
                found[total, 4], found[total, 5] = votes.support[m, c], vote
                total += 1
    return total
