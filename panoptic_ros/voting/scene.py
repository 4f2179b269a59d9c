"""Everything that the kernels need of one instant, in flat arrays."""
from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import Camera, ScoreMaps, ViewDetections, VisibilityLimit
from panoptic_ros.geometry import Lens
from panoptic_ros.voting import map_kernels
from panoptic_ros.voting.score_field import keypoint_widths

Array = np.ndarray
_NUMBERS = (
    "r00 r01 r02 r10 r11 r12 r20 r21 r22 tx ty tz fx skew cx fy cy k1 k2 p1 p2 k3 k4 fisheye fold "
    "width height columns rows a0 a1 a2 b0 b1 b2"
).split()
CAMERA = np.dtype([(name, np.float64) for name in _NUMBERS])  # the record of a view, see `VoteScene`
LENS_FIELDS = _NUMBERS[_NUMBERS.index("fx") : _NUMBERS.index("columns")]  # of the lens and of the image
OF_CAMERA = _NUMBERS.index("columns")  # so many numbers are those of the camera, the others of its maps


class VoteScene(NamedTuple):
    """V views of an instant, J joints, at most P people in a view; what `ViewField` says, as arrays.

    cameras: (V,) records `CAMERA`: rotation r00 to r22 and translation tx ty tz; matrix fx skew cx fy cy;
        terms of the lens k1 k2 p1 p2 k3, of a fisheye k1 k2 k3 k4; fisheye, 1 or 0; fold, the largest squared
        undistorted radius; width and height of the image, px; columns and rows of the maps, cells (0 without
        maps); cells from pixels a0 a1 a2, b0 b1 b2. Few arrays, because kernels are inlined only if they
        take few.
    people: (V, J, P, 4) pixel, 1 / (2 width^2), score; NaN pixels and score 0 where missing.
    gates: (V, P) squared px.
    map_start: (V, J) first value of the merged map in `map_data` (B,) uint8, -1 where keypoints count.
    patch_start: (V * J + 1) first patch of each view and joint in `patch_table`: (K, 6) person, column,
        row, width, height, first value in `patch_data` (B,) uint8.
    limits: (V * 3 + cells,) of each view the first cell of its `VisibilityLimit` (0 = none), columns, rows;
        then the cells of all views, row by row, m.
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


def build_scene(
    cameras: Sequence[Camera],
    views: Sequence[ViewDetections],
    joint_count: int,
    relative_width: float = 0.03,
    gate: float = 4.0,
) -> VoteScene:
    """The scene of V views and their cameras; see `ViewField` for the two numbers."""
    counts = np.array([len(view.points) for view in views], np.int64)
    most = int(counts.max(initial=0))
    of = np.repeat(np.arange(len(views)), counts)  # view and row of each person
    row = np.arange(len(of)) - (np.cumsum(counts) - counts)[of]
    points = np.concatenate([np.zeros((0, joint_count, 2)), *(view.points for view in views)])
    scores = np.concatenate([np.zeros((0, joint_count)), *(view.scores for view in views)])
    sizes = np.array([view.image_size for view in views], np.float64).reshape(-1, 2)[of]
    widths = keypoint_widths(points, (sizes[:, 0], sizes[:, 1]), relative_width)
    rates = np.broadcast_to((0.5 / widths**2)[:, None, None], (*scores.shape, 1))
    people = np.full((len(views), most, joint_count, 4), np.nan)
    people[..., 2:] = 0.0
    people[of, row] = np.concatenate([points, rates, scores[..., None]], axis=-1)
    gates = np.zeros((len(views), most))
    gates[of, row] = (gate * widths) ** 2
    table = _view_numbers(cameras, views)
    people = np.ascontiguousarray(people.swapaxes(1, 2))
    return VoteScene(table, people, gates, *_map_arrays(views, joint_count), limits=_limits(views))


def _view_numbers(cameras: Sequence[Camera], views: Sequence[ViewDetections]) -> Array:
    table = np.zeros((len(views), len(_NUMBERS)))
    if len(views):
        table[:, :OF_CAMERA] = [_camera_numbers(camera) for camera in cameras]
    mapped, maps = _maps_of(views)
    if mapped:
        table[mapped, OF_CAMERA : OF_CAMERA + 2] = [each.grid_size for each in maps]
        table[mapped, OF_CAMERA + 2 :] = np.array([each.grid_from_image for each in maps]).reshape(-1, 6)
    return table.view(CAMERA).reshape(-1)


def map_sizes(cameras: Array) -> Array:
    """Columns and rows (V, 2) of the maps of `VoteScene.cameras` (V,)."""
    return np.stack([cameras["columns"], cameras["rows"]], axis=-1).astype(np.int64)


def lens_of(camera: np.void) -> tuple[Lens, Array]:
    """The lens of a record `CAMERA`, and its terms as in `Intrinsics`."""
    names = ("k1", "k2", "k3", "k4") if camera["fisheye"] else ("k1", "k2", "p1", "p2", "k3")
    return ("fisheye" if camera["fisheye"] else "brown"), np.array([camera[name] for name in names])


def _limits(views: Sequence[ViewDetections]) -> Array:
    parts, end = [np.zeros(3 * len(views))], 3 * len(views)
    for v, view in enumerate(views):
        if view.limit is not None:
            rows, columns = view.limit.cells.shape
            parts[0][3 * v : 3 * v + 3] = end, columns, rows
            parts.append(_limit_metres(view.limit))
            end += rows * columns
    return np.concatenate(parts)


@lru_cache(maxsize=256)  # the limits of occluders stay the same from instant to instant
def _limit_metres(limit: VisibilityLimit) -> Array:
    return limit.metres.ravel()


@lru_cache(maxsize=4096)
def _camera_numbers(camera: Camera) -> tuple[float, ...]:
    """The numbers of a view that are those of its camera."""
    lens, pose = camera.intrinsics, camera.cam_from_world
    matrix = lens.matrix.ravel()[[0, 1, 2, 4, 5]]
    if lens.lens == "fisheye":
        k1, k2, k3, k4 = lens.distortion
        terms = (k1, k2, 0.0, 0.0, k3, k4, 1.0)
    else:
        terms = (*lens.distortion, 0.0, 0.0)
    rest = (*matrix, *terms, lens.radius_limit**2, *camera.image_size)
    return tuple(float(x) for x in (*pose.rotation.ravel(), *pose.translation, *rest))


def _maps_of(views: Sequence[ViewDetections]) -> tuple[list[int], list[ScoreMaps]]:
    """Which views have score maps, and these."""
    found = [(v, view.maps) for v, view in enumerate(views) if view.maps is not None]
    return [v for v, _ in found], [maps for _, maps in found]


def _map_arrays(
    views: Sequence[ViewDetections], joint_count: int
) -> tuple[Array, Array, Array, Array, Array]:
    count = len(views)
    grid = np.zeros((count, 2), np.int64)
    mapped, maps = _maps_of(views)
    if maps:
        grid[mapped] = [each.grid_size for each in maps]
    of = np.repeat(np.array(mapped, np.int64), [len(each.joints) for each in maps])
    table = np.zeros((len(of), 6), np.int64)
    key = of * joint_count
    if len(of):
        key += np.concatenate([each.joints for each in maps])
        table[:, 0] = np.concatenate([each.persons for each in maps])
        table[:, 1:3] = np.concatenate([each.corners for each in maps])
        table[:, 3:5] = np.concatenate([each.sizes for each in maps])
        lengths = table[:, 3] * table[:, 4]
        table[:, 5] = np.cumsum(lengths) - lengths
    patch_data = np.concatenate([np.zeros(0, np.uint8), *(each.data for each in maps)])
    order = np.argsort(key, kind="stable")
    table = table[order]
    patch_start = np.searchsorted(key[order], np.arange(count * joint_count + 1)).astype(np.int64)
    map_start: Array = np.full(count * joint_count, -1, np.int64)
    drawn = np.flatnonzero(np.diff(patch_start))
    cells = grid.prod(1)[drawn // max(joint_count, 1)]
    map_start[drawn] = np.cumsum(cells) - cells
    map_data = np.zeros(int(cells.sum()), np.uint8)
    map_start = map_start.reshape(count, joint_count)
    map_kernels.paint_maps(map_start, map_data, grid, patch_start, table, patch_data)
    return map_start, map_data, patch_start, table, patch_data
