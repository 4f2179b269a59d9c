"""Everything that the kernels need of one instant, in flat arrays."""
from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import Camera, ViewDetections, VisibilityLimit
from panoptic_ros.solving.evidence import FARTHEST
from panoptic_ros.voting.scene_kernels import Patches, Widths, merged_maps, people_of_views

Array = np.ndarray
MIN_WIDTH = 0.002  # least standard deviation of a 2D joint, as a fraction of the image's diagonal
_NUMBERS = (
    "r00 r01 r02 r10 r11 r12 r20 r21 r22 tx ty tz ox oy oz fx skew cx fy cy k1 k2 p1 p2 k3 k4 fisheye fold "
    "limit width height columns rows a0 a1 a2 b0 b1 b2"
).split()
CAMERA = np.dtype([(name, np.float64) for name in _NUMBERS])  # the record of a view, see `VoteScene`
OF_CAMERA = _NUMBERS.index("columns")  # so many numbers are those of the camera, the others of its maps


class VoteScene(NamedTuple):
    """V views of an instant, J joints, at most P people in a view; what `ViewField` says, as arrays.

    cameras: (V,) records `CAMERA`: rotation r00 to r22 and translation tx ty tz; centre ox oy oz; matrix
        fx skew cx fy cy; terms of the lens k1 k2 p1 p2 k3, of a fisheye k1 k2 k3 k4; fisheye, 1 or 0; the
        largest undistorted radius, squared (fold) and for `undistort_points` (limit); width and height of
        the image, px; columns and rows of the maps, cells (0 without maps); cells from pixels a0 a1 a2,
        b0 b1 b2.
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
    """The scene of V views and their cameras.

    Args:
        relative_width: standard deviation of a 2D joint's Gaussian, a fraction of the square root of the
            area of the box round the person's joints; not below `MIN_WIDTH` of the image's diagonal.
        gate: in standard deviations, within which maps of all people count for a person.
    """
    sizes = np.array([view.image_size for view in views], np.float64).reshape(-1, 2)
    widths = Widths(relative_width, gate, MIN_WIDTH * np.hypot(*sizes.T))
    points = np.concatenate([np.zeros((0, joint_count, 2)), *(view.points for view in views)])
    scores = np.concatenate([np.zeros((0, joint_count)), *(view.scores for view in views)])
    counts = np.array([len(view.points) for view in views], np.int64)
    people, gates = people_of_views(points, scores, counts, widths)
    patches = _patches(views)
    table = _view_numbers(tuple(cameras), views, patches.grids)
    map_start, map_data, patch_start, patch_table = merged_maps(patches, joint_count)
    return VoteScene(
        table, people, gates, map_start, map_data, patch_start, patch_table, patches.data, _limits(views)
    )


def _view_numbers(cameras: tuple[Camera, ...], views: Sequence[ViewDetections], grids: Array) -> Array:
    table = np.zeros((len(views), len(_NUMBERS)))
    table[:, :OF_CAMERA] = _camera_numbers(cameras)
    table[:, OF_CAMERA : OF_CAMERA + 2] = grids
    for v, view in enumerate(views):
        if view.maps is not None:
            table[v, OF_CAMERA + 2 :] = view.maps.grid_from_image.ravel()
    return table.view(CAMERA).reshape(-1)


@lru_cache(maxsize=256)
def _camera_numbers(cameras: tuple[Camera, ...]) -> Array:
    """The numbers (V, OF_CAMERA) of views that are those of their cameras."""
    rows = []
    for camera in cameras:
        lens, pose = camera.intrinsics, camera.cam_from_world
        if lens.lens == "fisheye":
            k1, k2, k3, k4 = lens.distortion
            terms = (k1, k2, 0.0, 0.0, k3, k4, 1.0)
        else:
            terms = (*lens.distortion, 0.0, 0.0)
        ends = (lens.radius_limit**2, min(lens.radius_limit, FARTHEST), *camera.image_size)
        matrix = lens.matrix.ravel()[[0, 1, 2, 4, 5]]
        rows.append((*pose.rotation.ravel(), *pose.translation, *camera.centre, *matrix, *terms, *ends))
    return np.array(rows, np.float64).reshape(-1, OF_CAMERA)


def _patches(views: Sequence[ViewDetections]) -> Patches:
    """The score maps of the views; those without have a grid of 0 cells."""
    maps = [view.maps for view in views if view.maps is not None]
    grids = [(0, 0) if view.maps is None else view.maps.grid_size for view in views]
    return Patches(
        np.array(grids, np.int64).reshape(-1, 2),
        np.array([0 if view.maps is None else len(view.maps.joints) for view in views], np.int64),
        np.concatenate([np.zeros(0, np.int32), *(each.joints for each in maps)]),
        np.concatenate([np.zeros(0, np.int32), *(each.persons for each in maps)]),
        np.concatenate([np.zeros((0, 2), np.int32), *(each.corners for each in maps)]),
        np.concatenate([np.zeros((0, 2), np.int32), *(each.sizes for each in maps)]),
        np.concatenate([np.zeros(0, np.uint8), *(each.data for each in maps)]),
    )


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
