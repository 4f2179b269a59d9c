"""Visibility of places in views, V(Z) of Joo et al. 2017, 5.1: depth limits beside the field of view."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain.checks import ShapeChecks
from panoptic_ros.errors import DataError

Array = np.ndarray
FARTHEST = 65.535  # m; larger depths are treated as unlimited
LONGER_SIDE = 160  # cells, greatest longer side of limits that are computed here


@dataclass(frozen=True, slots=True, eq=False)
class VisibilityLimit:
    """Depth up to which a view sees joints, from depth maps and known occluders.

    The cells divide the image evenly. Pixel (u, w) of an image of width x height px lies in column floor((u +
    0.5) W / width) and row floor((w + 0.5) H / height). The image's right and lower borders belong to the
    last column and row. A view sees a point of its image if the point's depth is at most the limit of its
    cell. The limit includes the distance that a joint may lie behind a measured surface.

    Args:
        cells: (H, W) uint16, mm along the camera's z axis; 0 = no limit.
    """

    cells: Array

    def __post_init__(self) -> None:
        given = np.asarray(self.cells)
        if given.dtype != np.uint16 or not given.size:
            raise DataError(f"VisibilityLimit.cells is {given.dtype} {given.shape}, expected uint16 (H, W)")
        ShapeChecks(self).store("cells", np.uint16, "H W")

    @classmethod
    def of_depths(cls, depths: Array, margin: float) -> VisibilityLimit:
        """Return the limit for surfaces with the given depths, one per cell of an even grid on the image.

        Cells that are smaller than needed are merged, and the farthest surface counts. A cell with an unknown
        depth has no limit.

        Args:
            depths: (h, w) m along z; 0, NaN and infinite = unknown.
            margin: Distance in m that a joint may lie behind a surface.

        Raises:
            DataError: on another shape, or a negative depth.
        """
        depths = np.asarray(depths)
        if depths.ndim != 2 or not depths.size:
            raise DataError(f"a depth map has shape {depths.shape}, expected (height, width)")
        known = np.isfinite(depths)
        if (depths[known] < 0.0).any():
            raise DataError(f"a depth map has a negative depth, {depths[known].min():.3f} m")
        unknown = ~known | (depths == 0.0)
        far = np.where(unknown, np.inf, depths)
        shrink = max(1.0, max(depths.shape) / LONGER_SIDE)
        for axis, size in enumerate(depths.shape):
            count = max(1, round(size / shrink))
            cell = np.floor((np.arange(size) + 0.5) * (count / size))
            far = np.maximum.reduceat(far, np.searchsorted(cell, np.arange(count)), axis=axis)
        millimetres = np.ceil(1e3 * (far.astype(np.float64) + margin) - 1e-6)
        return cls(np.where(millimetres <= 1e3 * FARTHEST, millimetres, 0.0).astype(np.uint16))

    @property
    def metres(self) -> Array:
        """Return the limits (H, W) float64 m, infinite where there are none."""
        return np.where(self.cells, self.cells * 1e-3, np.inf)

    def sees(self, pixels: Array, depths: Array, image_size: tuple[int, int]) -> Array:
        """Return whether points at pixels (..., 2) and depths (...) m are within the limit (...)."""
        shape = np.array(self.cells.shape[::-1])
        at = np.floor((np.asarray(pixels) + 0.5) * (shape / np.array(image_size))).astype(np.int64)
        at = np.clip(at, 0, shape - 1)
        seen: Array = depths <= self.metres[at[..., 1], at[..., 0]]
        return seen

    def combined(self, other: VisibilityLimit) -> VisibilityLimit:
        """Return the smaller of two limits of one view in every cell, at the finer resolution of both."""
        height, width = np.maximum(self.cells.shape, other.cells.shape)
        one, two = self._spread(height, width), other._spread(height, width)
        nearer = np.minimum(one - 1, two - 1)  # uint16: 0 (no limit) wraps to the largest value
        return VisibilityLimit(nearer + np.uint16(1))

    def _spread(self, height: int, width: int) -> Array:
        """Resample the cells to (height, width): each new cell takes the value at its centre."""
        rows = (2 * np.arange(height) + 1) * self.cells.shape[0] // (2 * height)
        columns = (2 * np.arange(width) + 1) * self.cells.shape[1] // (2 * width)
        return self.cells[np.ix_(rows, columns)]
