"""Everything that the kernels need of one instant, in flat arrays."""
from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import Camera, ViewDetections
from panoptic_ros.voting import map_kernels
from panoptic_ros.voting.score_field import keypoint_widths

Array = np.ndarray
CAMERA_NUMBERS = 34


class VoteScene(NamedTuple):
    """V views of an instant, J joints, at most P people in a view; what `ViewField` says, as arrays.

    cameras: (V, 34) rotation 3x3, translation, fx skew cx fy cy, k1 k2 p1 p2 k3, largest squared radius,
        image width and height, map width and height in cells (0 without maps), cells from pixels 2x3,
        one more for padding. Few arrays, because kernels are inlined only if they take few.
    people: (V, J, P, 4) pixel, 1 / (2 width^2), score; NaN pixels and score 0 where missing.
    gates: (V, P) squared px.
    map_start: (V, J) first value of the merged map in `map_data` (B,) uint8, -1 where keypoints count.
    patch_start: (V * J + 1) first patch of each view and joint in `patch_table`: (K, 6) person, column,
        row, width, height, first value in `patch_data` (B,) uint8.
    """

    cameras: Array
    people: Array
    gates: Array
    map_start: Array
    map_data: Array
    patch_start: Array
    patch_table: Array
    patch_data: Array


def build_scene(
    cameras: Sequence[Camera],
    views: Sequence[ViewDetections],
    joint_count: int,
    relative_width: float = 0.03,
    gate: float = 4.0,
) -> VoteScene:
    """The scene of V views and their cameras; see `ViewField` for the two numbers."""
    count = len(views)
    most = max((len(view.points) for view in views), default=0)
    people = np.full((count, joint_count, most, 4), np.nan)
    people[..., 2:] = 0.0
    gates = np.zeros((count, most))
    table = np.zeros((count, CAMERA_NUMBERS))
    for v, (camera, view) in enumerate(zip(cameras, views)):
        n = len(view.points)
        widths = keypoint_widths(view.points, view.image_size, relative_width)
        people[v, :, :n, :2] = view.points.swapaxes(0, 1)
        people[v, :, :n, 2] = 0.5 / widths**2
        people[v, :, :n, 3] = view.scores.T
        gates[v, :n] = (gate * widths) ** 2
        table[v] = _camera_numbers(camera, view)
    return VoteScene(table, people, gates, *_map_arrays(views, joint_count))


def _camera_numbers(camera: Camera, view: ViewDetections) -> Array:
    lens, pose, maps = camera.intrinsics, camera.cam_from_world, view.maps
    row = np.zeros(CAMERA_NUMBERS)
    row[:9], row[9:12] = pose.rotation.ravel(), pose.translation
    row[12:17] = lens.matrix.ravel()[[0, 1, 2, 4, 5]]
    row[17:22], row[22] = lens.distortion, lens.radius_limit**2
    row[23:25] = view.image_size
    if maps is not None:
        row[25:27], row[27:33] = maps.grid_size, maps.grid_from_image.ravel()
    return row


def _map_arrays(views: Sequence[ViewDetections], joint_count: int) -> tuple[Array, ...]:
    count = len(views)
    grid = np.zeros((count, 2), np.int64)
    tables, keys, data, offset = [np.zeros((0, 6), np.int64)], [np.zeros(0, np.int64)], [], 0
    for v, view in enumerate(views):
        maps = view.maps
        if maps is None:
            continue
        grid[v] = maps.grid_size
        lengths = maps.sizes.prod(1, dtype=np.int64)
        starts = offset + np.cumsum(lengths) - lengths
        tables.append(np.column_stack([maps.persons, maps.corners, maps.sizes, starts]).astype(np.int64))
        keys.append(v * joint_count + maps.joints.astype(np.int64))
        data.append(maps.data)
        offset += maps.data.size
    key = np.concatenate(keys)
    order = np.argsort(key, kind="stable")
    table = np.ascontiguousarray(np.concatenate(tables)[order])
    patch_start = np.searchsorted(key[order], np.arange(count * joint_count + 1)).astype(np.int64)
    patch_data = np.concatenate(data) if data else np.zeros(0, np.uint8)
    map_start = np.full(count * joint_count, -1, np.int64)
    mapped = np.flatnonzero(np.diff(patch_start))
    cells = grid.prod(1)[mapped // max(joint_count, 1)]
    map_start[mapped] = np.cumsum(cells) - cells
    map_data = np.zeros(int(cells.sum()), np.uint8)
    map_start = map_start.reshape(count, joint_count)
    map_kernels.paint_maps(map_start, map_data, grid, patch_start, table, patch_data)
    return map_start, map_data, patch_start, table, patch_data
