"""The exact search: local maxima of eq. 1, found coarse to fine without visiting empty space."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.voting import (
    box_kernels,
    kernels,
    limit_kernels,
    peak_kernels,
    pyramid_kernels,
    voxel_kernels,
)
from panoptic_ros.voting.lens_bounds import BINS, seen_radius, slope_bounds
from panoptic_ros.voting.scene import CAMERA, LENS_FIELDS, VoteScene, lens_of, map_sizes
from panoptic_ros.voting.score_field import GAUSSIAN_END
from panoptic_ros.voting.score_volume import ENOUGH, Peaks, no_peaks, sorted_peaks
from panoptic_ros.voting.volume import Volume

Array = np.ndarray
GROUP = box_kernels.GROUP
PAD = 6  # cells after each row: rows 4 KB apart would all need the same places in the cache
VIEW = np.dtype(
    [*CAMERA.descr, *((name, np.float64) for name in ("across", "bend_end", "far_x", "far_y")),
     ("bends", np.float64, (BINS, 2))]
)  # fmt: skip


class BoxScene(NamedTuple):
    """What the kernels of the search need of V views and of up to 32 joints.

    views: (V,) records `VIEW`: those of `VoteScene.cameras`; across, the sum of |R2k|; bend_end, the end of
        the lens bounds (0 without distortion); far_x and far_y, the largest |x| and |y| of the image in the
        plane at 1 m (with distortion the radius that is seen, twice); bends, the lens bounds.
    layers, spread, masks: see `pyramid_kernels`.
    people: (V, J, P, 4) pixel, 1 / (2 width^2), score; NaN where missing.
    reach: (V, P, 4) least and largest u, least and largest w that a person's keypoints reach.
    pointed: (V,) mask of the joints that have keypoints instead of maps.
    map_start, map_data: as in `VoteScene`, for these joints.
    limits: as in `VoteScene`; limit_layers (V, L, 3), limit_reach (N, 2): see `limit_kernels`.
    """

    views: Array
    layers: Array
    spread: Array
    masks: Array
    people: Array
    reach: Array
    pointed: Array
    map_start: Array
    map_data: Array
    limits: Array
    limit_layers: Array
    limit_reach: Array


class BoxSearch:
    """Finds what `dense_peaks` finds; holds the lens bounds of the cameras it has met, and memory."""

    def __init__(self) -> None:
        self._lenses: dict[bytes, tuple[Array, float, float]] = {}
        self._memory = new_pyramids(0)

    def peaks(
        self,
        scene: VoteScene,
        volume: Volume,
        threshold: float,
        view_threshold: float,
        enough: int,
        min_views: int,
    ) -> Peaks:
        """The local maxima of `dense_peaks` that at least `min_views` (not below `enough`) support."""
        views = self._views(scene)
        supporting = max(int(np.ceil(255.0 * view_threshold - 1e-6)), 1)  # value of a cell
        found = [(*no_peaks(), np.zeros(0, np.int64))]
        for first in range(0, scene.map_start.shape[1], GROUP):
            boxes = box_scene(scene, views, first, supporting, self._pyramids(scene))
            space = (np.array(volume.lower), np.array(volume.shape), volume.side)
            joints = (1 << min(GROUP, scene.map_start.shape[1] - first)) - 1
            every = np.column_stack([np.arange(len(views)), np.full(len(views), -1)]).astype(np.int32)
            small = (np.array([[0, 0, 0, joints, 0]]), np.array([0, len(views)]), every)
            for level in range(max(max(volume.shape) - 1, 1).bit_length() - 1, 0, -1):
                small = box_kernels.split(boxes, *small, level, *space, threshold, supporting, min_views)
            rows, votes = voxel_kernels.visit(boxes, *small, *space, threshold, view_threshold, min_views)
            found.append((rows[:, 0] + first, rows[:, 1:4], votes, rows[:, 4], rows[:, 5]))
        columns = [np.concatenate(parts) for parts in zip(*found)]
        joints, voxels, votes, _, likely = columns
        top, unknown = peak_kernels.highest(joints, voxels - volume.lower + 1, votes, likely)
        peaks = Peaks(*(values[top] for values in columns[:4]))
        if enough < min_views:
            good = self._unbeaten(scene, volume, peaks, unknown, view_threshold, enough)
            peaks = Peaks(*(values[good] for values in peaks))
        return sorted_peaks(peaks)

    def _pyramids(self, scene: VoteScene) -> tuple[Array, Array]:
        """Empty pyramids, large enough for the maps."""
        _, cells = pyramid_layers(map_sizes(scene.cameras))
        if cells >= len(self._memory[1]):
            self._memory = new_pyramids(cells)
        pyramid_kernels.clear_pyramids(*self._memory)
        return self._memory

    def _views(self, scene: VoteScene) -> Array:
        views = np.zeros(len(scene.cameras), VIEW)
        for name in CAMERA.fields or ():
            views[name] = scene.cameras[name]
        views["across"] = np.abs(np.stack([views["r20"], views["r21"], views["r22"]], -1)).sum(axis=1)
        for view in views:
            y = (np.array([-0.5, view["height"] - 0.5]) - view["cy"]) / view["fy"]
            x = (np.array([[-0.5], [view["width"] - 0.5]]) - view["cx"] - view["skew"] * y) / view["fx"]
            lens, terms = lens_of(view)
            if lens == "brown" and not terms.any():
                view["far_x"], view["far_y"] = np.abs(x).max() * 1.000001, np.abs(y).max() * 1.000001
                continue
            key = view[LENS_FIELDS].tobytes()
            if key not in self._lenses:
                fold, reach = float(np.sqrt(view["fold"])), float(np.hypot(x, y).max())
                seen = seen_radius(lens, terms, fold, reach)
                self._lenses[key] = (*slope_bounds(lens, terms, seen), seen)
            view["bends"], view["bend_end"], seen = self._lenses[key]
            view["far_x"] = view["far_y"] = seen
        return views

    @staticmethod
    def _unbeaten(
        scene: VoteScene, volume: Volume, peaks: Peaks, unknown: Array, view_threshold: float, enough: int
    ) -> Array:
        """Whether peaks are also above those unknown neighbours (K, 27) that `enough` views support."""
        of, step = np.nonzero(unknown)
        near = peaks.voxels[of] + np.stack([step // 9, step // 3 % 3, step % 3], axis=-1) - 1
        votes, support = kernels.vote_points(scene, peaks.joints[of], volume.centres(near), view_threshold)
        rival = (support >= enough) & volume.contains(near)
        votes, own = votes + ENOUGH, peaks.votes[of] + ENOUGH  # rounded as in `dense_peaks`
        beaten = rival & ((votes > own) | ((votes == own) & (step < 13)))
        unbeaten: Array = np.bincount(of[beaten], minlength=len(unknown)) == 0
        return unbeaten


def box_scene(
    scene: VoteScene, views: Array, first: int, supporting: int, pyramids: tuple[Array, Array]
) -> BoxScene:
    """The arrays of the joints first, first + 1, ..., at most 32; writes into empty `new_pyramids`."""
    count = min(GROUP, scene.map_start.shape[1] - first)
    grid = map_sizes(scene.cameras)
    layers, _ = pyramid_layers(grid)
    maps = (scene.map_start, scene.map_data, scene.patch_start, scene.patch_table)
    pyramid_kernels.build_pyramids(layers, *pyramids, grid, *maps, first, supporting)
    mine = slice(first, first + count)
    people = scene.people[:, mine].copy()
    people[scene.map_start[:, mine] >= 0] = np.nan
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.sqrt(GAUSSIAN_END / people[..., 2])
    known = people[..., 3] > 0.0
    people[~known] = np.nan
    u, w = people[..., 0], people[..., 1]
    boxes = np.stack([u - reach, -u - reach, w - reach, -w - reach], axis=-1)
    boxes = np.where(known[..., None], boxes, np.inf).min(axis=1, initial=np.inf) * (1.0, -1.0, 1.0, -1.0)
    pointed = (known.any(axis=2) * (1 << np.arange(count))).sum(axis=1)
    return BoxScene(
        views, layers, *pyramids, people, np.ascontiguousarray(boxes), pointed,
        np.ascontiguousarray(scene.map_start[:, mine]), scene.map_data, scene.limits, *_limit_pyramids(scene),
    )  # fmt: skip


def _limit_pyramids(scene: VoteScene) -> tuple[Array, Array]:
    """Layers and pyramids of the limits; next to nothing where there are none."""
    count = len(scene.cameras)
    layers, cells = pyramid_layers(scene.limits[: 3 * count].reshape(-1, 3)[:, 1:].astype(np.int64))
    reach = np.empty((cells, 2))
    limit_kernels.build_limits(layers, reach, scene.limits)
    return layers, reach


def new_pyramids(cells: int) -> tuple[Array, Array]:
    """Empty `BoxScene.spread` and `masks`, and a cell more that is always empty.

    No row of the former lies across two lines of the cache.
    """
    cells += 1
    buffer = np.zeros(cells * GROUP + 63, np.uint8)
    skip = -buffer.ctypes.data % 64
    return buffer[skip : skip + cells * GROUP].reshape(cells, GROUP), np.zeros(cells, np.int64)


def pyramid_layers(grid: Array) -> tuple[Array, int]:
    """Layers (V, L, 3) of pyramids on maps of grid (V, 2) cells, up to a single cell, and all cells.

    Widths are those of the rows in memory, which end in empty cells.
    """
    most = max(int(grid.max(initial=1)) - 1, 0).bit_length() + 1
    size = grid.copy()
    layers = np.zeros((len(grid), most, 3), np.int64)
    for layer in range(most):
        layers[:, layer, 1:] = size
        layers[:, layer, 1] += np.where(size[:, 0] > PAD, PAD, 0)
        done = np.all(size <= 1, axis=1)
        size = np.where(done[:, None], 0, (size + 1) // 2)
    cells = layers[..., 1] * layers[..., 2]
    layers[..., 0] = (np.cumsum(cells) - cells.ravel()).reshape(cells.shape)
    return layers, int(cells.sum())
