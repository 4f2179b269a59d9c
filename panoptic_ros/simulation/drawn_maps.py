"""Score maps drawn from 2D poses, as a network would output them: a Gaussian blob around every joint."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from panoptic_ros.domain import DetectionSet, ScoreMaps, ViewDetections

Array = np.ndarray


@dataclass(frozen=True)
class MapDrawing:
    """Grid of a network's score maps and the shape of its blobs.

    Args:
        network: Input size (width, height) px. The image is scaled to fit at the top left.
        stride: Input px per cell.
        sigma: Standard deviation of a blob, in cells.
        cut: Threshold below which values become 0.
    """

    network: tuple[int, int] = (512, 288)
    stride: int = 4
    sigma: float = 1.3
    cut: float = 0.05

    @property
    def grid_size(self) -> tuple[int, int]:
        """Return width and height of the grid in cells."""
        return self.network[0] // self.stride, self.network[1] // self.stride

    def grid_from_image(self, image_size: tuple[int, int]) -> Array:
        """Return the affine map (2, 3) from image to grid, see `ScoreMaps`.

        Pixel centres and cell centres have integer coordinates.
        """
        scale = min(n / s for n, s in zip(self.network, image_size)) / self.stride
        shift = 0.5 * scale - 0.5
        return np.array([[scale, 0.0, shift], [0.0, scale, shift]])


def with_drawn_maps(item: DetectionSet, drawing: MapDrawing) -> DetectionSet:
    """Return the same detections with score maps drawn for every view."""
    views = tuple(replace(view, maps=draw_maps(view, drawing)) for view in item.views)
    return replace(item, views=views)


def draw_maps(view: ViewDetections, drawing: MapDrawing) -> ScoreMaps:
    """Return one patch per joint inside the grid, for every person; its peak is the joint's score."""
    affine, grid = drawing.grid_from_image(view.image_size), np.array(drawing.grid_size)
    persons, joints = np.nonzero(view.scores > 0.0)
    cells = view.points[persons, joints] @ affine[:, :2].T + affine[:, 2]
    inside = ((cells >= -0.5) & (cells <= grid - 0.5)).all(axis=1)
    persons, joints, cells = persons[inside], joints[inside], cells[inside]
    reach = int(np.ceil(drawing.sigma * np.sqrt(2.0 * np.log(1.0 / drawing.cut))))
    sides = np.minimum(2 * reach + 1, grid)
    corners = np.clip(np.rint(cells).astype(np.int64) - reach, 0, grid - sides)
    across = (corners[:, :1] + np.arange(sides[0]) - cells[:, :1]) ** 2
    down = (corners[:, 1:] + np.arange(sides[1]) - cells[:, 1:]) ** 2
    squares = down[:, :, None] + across[:, None, :]
    values = view.scores[persons, joints, None, None] * np.exp(-squares / (2.0 * drawing.sigma**2))
    levels = np.where(values >= drawing.cut, np.rint(255.0 * values), 0.0).astype(np.uint8)
    sizes = np.broadcast_to(sides, corners.shape)
    return ScoreMaps(drawing.grid_size, affine, joints, persons, corners, sizes, levels.ravel())
