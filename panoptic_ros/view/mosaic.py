"""Several views in one picture."""

from __future__ import annotations

import math
from collections.abc import Mapping

import cv2
import numpy as np

from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.view.overlay import draw_text

Array = np.ndarray
GAP = 4  # px between tiles
GROUND = 24  # grey of what no image covers


class Mosaic:
    """A grid of tiles of equal size, as large as fits, the same for every instant.

    Args:
        sizes: (width, height) px of each view's images, by the view's name, in the order of tiles.
        max_size: (width, height) px that the picture must not exceed.

    Attributes:
        size: (width, height) of the picture, even numbers as video encoders want them.
        scales: by name, how much smaller than its images a view is shown.

    Raises:
        UsageError: without views, or if there is not one pixel for each.
    """

    def __init__(self, sizes: Mapping[str, tuple[int, int]], max_size: tuple[int, int] = (1920, 1080)):
        if not sizes:
            raise UsageError("a mosaic of no views")
        self.names = tuple(sizes)
        width = max(size[0] for size in sizes.values())
        height = max(size[1] for size in sizes.values())
        self.columns, scale = _best_grid(len(sizes), width, height, max_size)
        self.rows = -(-len(sizes) // self.columns)
        self._tile = (max(1, int(width * scale)), max(1, int(height * scale)))
        self.scales = {
            name: min(self._tile[0] / size[0], self._tile[1] / size[1]) for name, size in sizes.items()
        }
        across = self.columns * (self._tile[0] + GAP) - GAP
        down = self.rows * (self._tile[1] + GAP) - GAP
        self.size = (across + across % 2, down + down % 2)

    def compose(self, images: Mapping[str, Array], caption: str = "") -> Array:
        """The picture (H, W, 3) uint8 of views (h, w, 3) of any size; views without image say so.

        Args:
            images: by name; full size, or already scaled by `scales`.
            caption: text in the lower left corner.

        Raises:
            DataError: for an image of a view that the mosaic does not have.
        """
        unknown = sorted(set(images) - set(self.names))
        if unknown:
            raise DataError(f"the mosaic has no view {', '.join(unknown)}; it has {', '.join(self.names)}")
        canvas = np.full((self.size[1], self.size[0], 3), GROUND, np.uint8)
        size = max(0.35, min(self._tile) / 700.0)
        for i, name in enumerate(self.names):
            left = i % self.columns * (self._tile[0] + GAP)
            top = i // self.columns * (self._tile[1] + GAP)
            tile = canvas[top : top + self._tile[1], left : left + self._tile[0]]
            self._fill(tile, images.get(name))
            text = name if name in images else f"{name}: no image"
            draw_text(tile, text, (8, round(8 + 30 * size)), size, (255, 255, 255))
        if caption:
            draw_text(canvas, caption, (8, self.size[1] - 10), size, (255, 255, 255))
        return canvas

    def _fill(self, tile: Array, image: Array | None) -> None:
        if image is None:
            return
        scale = min(tile.shape[1] / image.shape[1], tile.shape[0] / image.shape[0])
        if abs(scale - 1.0) > 1.0 / max(tile.shape):
            size = (max(1, int(image.shape[1] * scale)), max(1, int(image.shape[0] * scale)))
            image = cv2.resize(image, size, interpolation=cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR)
        height, width = min(image.shape[0], tile.shape[0]), min(image.shape[1], tile.shape[1])
        top, left = (tile.shape[0] - height) // 2, (tile.shape[1] - width) // 2
        tile[top : top + height, left : left + width] = image[:height, :width]


def _best_grid(count: int, width: int, height: int, limit: tuple[int, int]) -> tuple[int, float]:
    """Number of columns and scale that show tiles of (width, height) largest, never enlarged.

    Of grids that are as large, the one whose shape is most like that of the limit.
    """
    best, best_shape = (1, 0.0), math.inf
    for columns in range(1, count + 1):
        rows = -(-count // columns)
        room_x, room_y = limit[0] - (columns - 1) * GAP, limit[1] - (rows - 1) * GAP
        # one pixel is kept free where the sum is odd and must be made even
        scale = min(1.0, (room_x - 1) / (columns * width), (room_y - 1) / (rows * height))
        shape = abs(math.log(columns * width * limit[1] / (rows * height * limit[0])))
        if scale > best[1] or (scale == best[1] and shape < best_shape):
            best, best_shape = (columns, scale), shape
    if best[1] * min(width, height) < 1.0:
        raise UsageError(f"{count} views do not fit a picture of {limit[0]}x{limit[1]}")
    return best
