"""The compiled loops of `build_scene`."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.kernels import inlined, njit

Array = np.ndarray
MIN_ASPECT = 0.25  # a person's box is taken to be at least so wide, relative to its longer side

_jit = njit(cache=True, error_model="numpy", nogil=True)


class Widths(NamedTuple):
    """How wide the Gaussians of 2D joints are.

    relative: to the square root of the area of the person's box. gate: in standard deviations.
    floors: (V,) px, the least standard deviation in each view.
    """

    relative: float
    gate: float
    floors: Array


class Patches(NamedTuple):
    """The patches of all views, one after another.

    grids: (V, 2) columns and rows of the maps; counts: (V,) patches; joints, persons (K,), corners, sizes
    (K, 2), data (B,): as in `ScoreMaps`.
    """

    grids: Array
    counts: Array
    joints: Array
    persons: Array
    corners: Array
    sizes: Array
    data: Array


@_jit
def people_of_views(points, scores, counts, widths):
    """`VoteScene.people` and `gates` from 2D people (D, J, 2) px, scores (D, J), each view's number (V,)."""
    views, joints, most = len(counts), points.shape[1], 0
    for v in range(views):
        most = max(most, counts[v])
    people, gates = np.zeros((views, joints, most, 4)), np.zeros((views, most))
    people[..., :2] = np.nan
    d = np.int64(0)  # no literal, which would be a type of its own
    for v in range(views):
        for i in range(counts[v]):
            width = max(widths.relative * np.sqrt(_area(points, d)), widths.floors[v])
            gates[v, i] = (widths.gate * width) ** 2
            for j in range(joints):
                people[v, j, i, 0], people[v, j, i, 1] = points[d, j, 0], points[d, j, 1]
                people[v, j, i, 2], people[v, j, i, 3] = 0.5 / width**2, scores[d, j]
            d += 1
    return people, gates


@inlined
def _area(points, d):
    """Of the box round the joints of person d, px^2."""
    left = top = np.inf
    right = bottom = -np.inf
    for j in range(points.shape[1]):
        u, w = points[d, j, 0], points[d, j, 1]
        if np.isfinite(u) and np.isfinite(w):
            left, right, top, bottom = min(left, u), max(right, u), min(top, w), max(bottom, w)
    wide, high = max(right - left, 0.0), max(bottom - top, 0.0)
    longer = max(wide, high)
    return max(min(wide, high), MIN_ASPECT * longer) * longer


@_jit
def merged_maps(patches, joint_count):
    """`VoteScene.map_start`, `map_data`, `patch_start` and `patch_table`."""
    views = len(patches.counts)
    start, table = _sorted_patches(patches, joint_count)
    map_start, cells = np.full((views, joint_count), -1, np.int64), 0
    for v in range(views):
        for j in range(joint_count):
            if start[v * joint_count + j] < start[v * joint_count + j + 1]:
                map_start[v, j] = cells
                cells += patches.grids[v, 0] * patches.grids[v, 1]
    data, values = np.zeros(cells, np.uint8), patches.data
    for v in range(views):
        for j in range(joint_count):
            for k in range(start[v * joint_count + j], start[v * joint_count + j + 1]):
                column, row, width, height, first = table[k, 1:]
                for y in range(height):
                    at = map_start[v, j] + (row + y) * patches.grids[v, 0] + column
                    for x in range(width):
                        data[at + x] = max(data[at + x], values[first + y * width + x])
    return map_start, data, start, table


@_jit
def _sorted_patches(patches, joint_count):
    """`VoteScene.patch_start` and `patch_table`: by view and joint, else in the order in which they came."""
    joints, persons, corners, sizes = patches.joints, patches.persons, patches.corners, patches.sizes
    start = np.zeros(len(patches.counts) * joint_count + 1, np.int64)
    keys, table = np.empty(len(joints), np.int64), np.empty((len(joints), 6), np.int64)
    k = 0
    for v in range(len(patches.counts)):
        for _ in range(patches.counts[v]):
            keys[k] = v * joint_count + joints[k]
            start[keys[k] + 1] += 1
            k += 1
    for key in range(1, len(start)):
        start[key] += start[key - 1]
    free, first = start.copy(), 0
    for k in range(len(joints)):
        at, width, height = free[keys[k]], sizes[k, 0], sizes[k, 1]
        free[keys[k]] += 1
        table[at, 0], table[at, 1], table[at, 2] = persons[k], corners[k, 0], corners[k, 1]
        table[at, 3], table[at, 4], table[at, 5] = width, height, first
        first += width * height
    return start, table
