"""The exact search: local maxima of eq. 1, found coarse to fine without visiting empty space."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.voting import (
    box_kernels,
    kernels,
    peak_kernels,
    pyramid_kernels,
    rectangle_kernels,
    voxel_kernels,
)
from panoptic_ros.voting.lens_bounds import BINS, seen_radius, slope_bounds
from panoptic_ros.voting.scene import VoteScene
from panoptic_ros.voting.score_field import GAUSSIAN_END
from panoptic_ros.voting.score_volume import ENOUGH, Peaks, sorted_peaks
from panoptic_ros.voting.volume import Volume

Array = np.ndarray
GROUP = rectangle_kernels.GROUP
PAD = 6  # cells after each row: rows 4 KB apart would all need the same places in the cache


class BoxScene(NamedTuple):
    """What the kernels of the search need of V views and of up to 32 joints.

    views: (V, 550) the numbers of `VoteScene.cameras`, then the sum of |R2k|, the end of the lens bounds
        (0 without distortion), the largest |x| and |y| of the image in the plane at 1 m (with distortion
        twice the radius that is seen), the lens bounds.
    layers: (V, L, 3) first cell, width in memory, height; values (N, 32) uint8: pyramids.
    spread: (N, 32) uint8, the largest values of each cell and those right, below, and both.
    people: (V, J, P, 4) pixel, 1 / (2 width^2), score; NaN where missing.
    reach: (V, P, 4) least and largest u, least and largest w that a person's keypoints reach.
    pointed: (V,) mask of the joints that have keypoints instead of maps.
    """

    views: Array
    layers: Array
    values: Array
    spread: Array
    people: Array
    reach: Array
    pointed: Array


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
        found = [(np.zeros(0, np.int64), np.zeros((0, 3), np.int64), np.zeros(0), np.zeros(0, np.int64))]
        for first in range(0, scene.map_start.shape[1], GROUP):
            boxes = box_scene(scene, views, first, self._pyramids(scene))
            space = (np.array(volume.lower), np.array(volume.shape), volume.side)
            joints = min(GROUP, scene.map_start.shape[1] - first)
            every = np.arange(len(views), dtype=np.int32)
            small = (np.array([[0, 0, 0, (1 << joints) - 1, 0]]), np.array([0, len(views)]), every)
            for level in range(max(max(volume.shape) - 1, 1).bit_length() - 1, 0, -1):
                small = box_kernels.split(boxes, *small, level, *space, threshold, supporting, min_views)
            few = (small[0][:, 3:4] >> np.arange(joints) & 1).sum(axis=1) <= voxel_kernels.FEW
            limits = (*space, threshold, view_threshold)
            for rows, votes in (
                voxel_kernels.visit(boxes, np.flatnonzero(~few), *small, *limits, supporting, min_views),
                voxel_kernels.visit_few(boxes, np.flatnonzero(few), *small, *limits, min_views),
            ):
                found.append((rows[:, 0] + first, rows[:, 1:4], votes, rows[:, 4]))
        every = Peaks(*(np.concatenate(parts) for parts in zip(*found)))
        top, unknown = peak_kernels.highest(every.joints, every.voxels - volume.lower + 1, every.votes)
        peaks = Peaks(*(values[top] for values in every))
        if enough < min_views:
            good = self._unbeaten(scene, volume, peaks, unknown, view_threshold, enough)
            peaks = Peaks(*(values[good] for values in peaks))
        return sorted_peaks(peaks)

    def _pyramids(self, scene: VoteScene) -> tuple[Array, ...]:
        """Empty pyramids, large enough for the maps."""
        _, cells = pyramid_layers(scene.cameras[:, 25:27].astype(np.int64))
        if cells > len(self._memory[1]):
            self._memory = new_pyramids(cells)
        pyramid_kernels.clear_pyramids(*self._memory)
        return self._memory

    def _views(self, scene: VoteScene) -> Array:
        count = len(scene.cameras)
        views = np.zeros((count, rectangle_kernels.BEND + 2 * BINS))
        views[:, :34] = scene.cameras
        views[:, 34] = np.abs(scene.cameras[:, 6:9]).sum(axis=1)
        for v, row in enumerate(scene.cameras):
            y = (np.array([-0.5, row[24] - 0.5]) - row[16]) / row[15]
            x = (np.array([[-0.5], [row[23] - 0.5]]) - row[14] - row[13] * y) / row[12]
            if row[17:22].any():
                key = row[12:25].tobytes()
                if key not in self._lenses:
                    seen = seen_radius(row[17:22], float(np.sqrt(row[22])), float(np.hypot(x, y).max()))
                    self._lenses[key] = (*slope_bounds(row[17:22], seen), seen)
                bounds, views[v, 35], views[v, 36:38] = self._lenses[key]
                views[v, rectangle_kernels.BEND :] = bounds.ravel()
            else:
                views[v, 36:38] = np.abs(x).max() * 1.000001, np.abs(y).max() * 1.000001
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
        return np.bincount(of[beaten], minlength=len(unknown)) == 0


def box_scene(scene: VoteScene, views: Array, first: int, pyramids: tuple[Array, ...]) -> BoxScene:
    """The arrays of the joints first, first + 1, ..., at most 32; writes into empty `new_pyramids`."""
    joint_count = scene.map_start.shape[1]
    count = min(GROUP, joint_count - first)
    layers, _ = pyramid_layers(scene.cameras[:, 25:27].astype(np.int64))
    values, filled, spread, reached = pyramids
    pyramid_kernels.paint_pyramids(
        layers, values, filled, scene.patch_start, scene.patch_table, scene.patch_data, joint_count, first
    )
    pyramid_kernels.spread_pyramids(layers, values, filled, spread, reached)
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
    return BoxScene(views, layers, values, spread, people, np.ascontiguousarray(boxes), pointed)


def new_pyramids(cells: int) -> tuple[Array, Array, Array, Array]:
    """Empty values (N, 32), where they are not 0 (N,), the same for `BoxScene.spread`."""
    return _aligned(cells), np.zeros(cells, np.bool_), _aligned(cells), np.zeros(cells, np.bool_)


def _aligned(cells: int) -> Array:
    """Zeros (cells, 32) uint8 none of whose rows lies across two lines of the cache."""
    buffer = np.zeros(cells * GROUP + 63, np.uint8)
    skip = -buffer.ctypes.data % 64
    return buffer[skip : skip + cells * GROUP].reshape(cells, GROUP)


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
        done = (size <= 1).all(axis=1)
        size = np.where(done[:, None], 0, (size + 1) // 2)
    cells = layers[..., 1] * layers[..., 2]
    layers[..., 0] = (np.cumsum(cells) - cells.ravel()).reshape(cells.shape)
    return layers, int(cells.sum())
