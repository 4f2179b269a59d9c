"""Merging of the score maps of several image regions into patches on one grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from panoptic_ros.detection.config import DetectionConfig
from panoptic_ros.detection.patch_kernels import raise_levels
from panoptic_ros.detection.people import DetectedPeople
from panoptic_ros.detection.preprocess import composed, inverted
from panoptic_ros.detection.score_maps import PatchSet, gate_radius, merged_patches, quantised

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class RegionMaps:
    """Score maps of one region.

    Args:
        maps: (K, h, w) score maps.
        grid_from_image: (2, 3) affine map from px of the image to cells.
        end: Right and bottom px of the region. Cells beyond it show padding.
    """

    maps: Array
    grid_from_image: Array
    end: tuple[int, int]

    @property
    def cells(self) -> tuple[int, int]:
        """Return the number of columns and rows of cells that show the image."""
        grid = self.grid_from_image
        border = grid[:, :2] @ (self.end[0] - 0.5, self.end[1] - 0.5) + grid[:, 2]
        columns, rows = np.minimum(np.ceil(border + 0.5).astype(int), self.maps.shape[:0:-1])
        return int(columns), int(rows)


def merged_maps(parts: Sequence[RegionMaps], people: DetectedPeople, config: DetectionConfig) -> PatchSet:
    """Merge the maps of one or more regions into patches; people are in px of the image.

    One region keeps its grid. For several regions, the finest grid is extended over all of them, and the
    other maps are resampled on it. Where regions overlap, the larger value counts.
    """
    finest = max(parts, key=lambda part: float(part.grid_from_image[0, 0]))
    if len(parts) == 1:
        columns, rows = finest.cells
        levels, grid = quantised(finest.maps[:, :rows, :columns], config.map_cut), finest.grid_from_image
    else:
        levels, grid = _common(parts, finest.grid_from_image, config.map_cut)
    on_grid = people.transformed(grid)
    seen = people.scores >= config.joint_threshold
    patches = merged_patches(levels, on_grid.points, seen, gate_radius(on_grid.heights()))
    return PatchSet((levels.shape[2], levels.shape[1]), grid, patches)


def _common(parts: Sequence[RegionMaps], grid: Array, cut: float) -> tuple[Array, Array]:
    """Return levels (K, h, w) uint8 on a grid that covers all parts, and its (2, 3) map from image px."""
    windows = []
    for part in parts:
        ours = composed(grid, inverted(part.grid_from_image))
        low = np.floor(ours[:, 2]).astype(int)
        high = np.ceil(ours[:, :2] @ (np.array(part.cells) - 1.0) + ours[:, 2]).astype(int) + 1
        windows.append((low, high))
    first = np.min([low for low, _ in windows], axis=0)
    width, height = np.max([high for _, high in windows], axis=0) - first
    levels = np.zeros((len(parts[0].maps), height, width), np.uint8)
    for part, (low, high) in zip(parts, windows):
        theirs = composed(part.grid_from_image, inverted(grid))
        across = theirs[0, 0] * np.arange(low[0], high[0]) + theirs[0, 2]
        down = theirs[1, 1] * np.arange(low[1], high[1]) + theirs[1, 2]
        (left, top), (columns, rows) = (low - first).tolist(), part.cells
        maps = np.ascontiguousarray(part.maps, np.float32)
        raise_levels(levels, (top, left), maps, (rows, columns), (down, across), cut)
    shift = np.array([[1.0, 0.0, -first[0]], [0.0, 1.0, -first[1]]])
    return levels, composed(shift, grid)


def warm_up() -> None:
    """Compile the kernels for maps of several regions."""
    levels, maps = np.zeros((1, 2, 2), np.uint8), np.zeros((1, 2, 2), np.float32)
    raise_levels(levels, (0, 0), maps, (1, 1), (np.zeros(1), np.zeros(1)), 0.1)
