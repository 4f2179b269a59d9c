"""Flat arrays of one instant for the voting kernels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import Camera, ViewDetections
from panoptic_ros.domain.rig_arrays import CAMERA, camera_records
from panoptic_ros.kernels import inlined, njit
from panoptic_ros.solving.scene import limits_of

Array = np.ndarray
MIN_WIDTH = 0.002  # least standard deviation of a 2D joint's Gaussian, as a share of the image diagonal
KEYPOINT_WIDTH = 0.03  # standard deviation of a 2D joint's Gaussian / root of the person's box area
PERSON_GATE = 4.0  # standard deviations from a 2D joint within which merged maps count for its person
MIN_ASPECT = 0.25  # least width of a person's box relative to its longer side

_jit = njit(cache=True, error_model="numpy", nogil=True)


class VoteScene(NamedTuple):
    """Arrays of V views of an instant, with J joints and at most P people per view.

    Args:
        cameras: (V,) see `camera_records`. Also set here: columns and rows of the maps in cells (0 without
            maps), and the map a0 a1 a2, b0 b1 b2 from pixels to cells.
        people: (V, J, P, 4) pixel, 1 / (2 width^2), score; NaN pixels and score 0 where missing.
        gates: (V, P) squared px.
        map_start: (V, J) index of the first value of the merged map in `map_data`, -1 where keypoints count.
        map_data: (B,) uint8.
        patch_start: (V * J + 1) first patch of each view and joint in `patch_table`.
        patch_table: (K, 6) person, column, row, width, height, index of the first value in `patch_data`.
        patch_data: (B,) uint8.
        limits: See `limits_of`.
    """

    cameras: Array
    people: Array
    gates: Array
    map_start: Array
    map_data: Array
    patch_start: Array
    patch_table: Array
    patch_data: Array
    limits: Array


class ViewPatches(NamedTuple):
    """Patches of all views, one after another.

    Args:
        grids: (V, 2) columns and rows of the maps.
        counts: (V,) number of patches.
        joints, persons: (K,) as in `ScoreMaps`.
        corners, sizes: (K, 2) as in `ScoreMaps`.
        data: (B,) as in `ScoreMaps`.
    """

    grids: Array
    counts: Array
    joints: Array
    persons: Array
    corners: Array
    sizes: Array
    data: Array


def build_scene(cameras: Sequence[Camera], views: Sequence[ViewDetections], joint_count: int) -> VoteScene:
    """Return the scene of V views and their cameras."""
    sizes = np.array([view.image_size for view in views], np.float64).reshape(-1, 2)
    points = np.concatenate([np.zeros((0, joint_count, 2)), *(view.points for view in views)])
    scores = np.concatenate([np.zeros((0, joint_count)), *(view.scores for view in views)])
    counts = np.array([len(view.points) for view in views], np.int64)
    people, gates = people_of_views(points, scores, counts, MIN_WIDTH * np.hypot(*sizes.T))
    patches = _patches(views)
    records = camera_records(tuple(cameras)).copy()
    numbers = records.view(np.float64).reshape(len(views), len(CAMERA.names or ()))
    numbers[:, -8:-6] = patches.grids
    for row, view in zip(numbers, views):
        if view.maps is not None:
            row[-6:] = view.maps.grid_from_image.ravel()
    patch_start, patch_table = sorted_patches(patches, joint_count)
    map_start, map_data = merged_maps(patches, patch_start, patch_table, joint_count)
    return VoteScene(
        records, people, gates, map_start, map_data, patch_start, patch_table, patches.data, limits_of(views)
    )


def _patches(views: Sequence[ViewDetections]) -> ViewPatches:
    """Return the score maps of the views; a view without maps has a grid of 0 cells."""
    maps = [view.maps for view in views if view.maps is not None]
    grids = [(0, 0) if view.maps is None else view.maps.grid_size for view in views]
    return ViewPatches(
        np.array(grids, np.int64).reshape(-1, 2),
        np.array([0 if view.maps is None else len(view.maps.joints) for view in views], np.int64),
        np.concatenate([np.zeros(0, np.int32), *(each.joints for each in maps)]),
        np.concatenate([np.zeros(0, np.int32), *(each.persons for each in maps)]),
        np.concatenate([np.zeros((0, 2), np.int32), *(each.corners for each in maps)]),
        np.concatenate([np.zeros((0, 2), np.int32), *(each.sizes for each in maps)]),
        np.concatenate([np.zeros(0, np.uint8), *(each.data for each in maps)]),
    )


@_jit
def people_of_views(points, scores, counts, least_widths):
    """Return `VoteScene.people` and `gates`.

    Args:
        points, scores: (D, J, 2) px and (D, J) of the 2D poses.
        counts: (V,) number of 2D poses in each view.
        least_widths: (V,) px, least standard deviation of their Gaussians.
    """
    views, joints, most = len(counts), points.shape[1], 0
    for v in range(views):
        most = max(most, counts[v])
    people, gates = np.zeros((views, joints, most, 4)), np.zeros((views, most))
    people[..., :2] = np.nan
    d = np.int64(0)  # not a literal, which would be a type of its own in numba
    for v in range(views):
        for i in range(counts[v]):
            width = max(KEYPOINT_WIDTH * np.sqrt(_area(points, d)), least_widths[v])
            gates[v, i] = (PERSON_GATE * width) ** 2
            for j in range(joints):
                people[v, j, i, 0], people[v, j, i, 1] = points[d, j, 0], points[d, j, 1]
                people[v, j, i, 2], people[v, j, i, 3] = 0.5 / width**2, scores[d, j]
            d += 1
    return people, gates


@inlined
def _area(points, d):
    """Return the area, px^2, of the box round the joints of person d, widened to `MIN_ASPECT`."""
    left = top = np.inf
    right = bottom = -np.inf
    for j in range(points.shape[1]):
        u, w = points[d, j, 0], points[d, j, 1]
        if np.isfinite(u) and np.isfinite(w):
            left, right, top, bottom = min(left, u), max(right, u), min(top, w), max(bottom, w)
    wide, high = max(right - left, 0.0), max(bottom - top, 0.0)
    longer = max(wide, high)
    return max(min(wide, high), MIN_ASPECT * longer) * longer


def sorted_patches(patches: ViewPatches, joint_count: int) -> tuple[Array, Array]:
    """Return `VoteScene.patch_start` and `patch_table`, stably sorted by view and joint."""
    keys = np.repeat(np.arange(len(patches.counts)), patches.counts) * joint_count + patches.joints
    cells = patches.sizes.prod(axis=1, dtype=np.int64)
    table = np.column_stack([patches.persons, patches.corners, patches.sizes, np.cumsum(cells) - cells])
    counts = np.bincount(keys, minlength=len(patches.counts) * joint_count)
    start = np.concatenate([[0], np.cumsum(counts)])
    return start, np.ascontiguousarray(table[np.argsort(keys, kind="stable")], np.int64)


@_jit
def merged_maps(patches, start, table, joint_count):
    """Return `VoteScene.map_start` and `map_data`."""
    views = len(patches.counts)
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
    return map_start, data
