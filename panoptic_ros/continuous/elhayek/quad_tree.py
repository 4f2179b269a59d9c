"""Image blobs: the leaves of a quad tree of an image as Gaussians with a colour (paper, 4; Stoll et al. 2011).

A square whose colours spread more than a threshold is split into four. A leaf becomes a Gaussian at its
centre; its standard deviation is half of its side.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import Camera

Array = np.ndarray
MOST_COLUMNS = 320  # px, larger images are reduced: the paper's have 162 columns
LEVELS = 5  # sides of leaves: 1, 2, ... 16 px of the reduced image
LEAST_LEVEL = 1  # leaves have at least 2 px per side: single pixels are mostly noise
# root mean square distance from the mean colour of a square, above which it is split. A large
# value merges limbs with a similar background.
SPREAD = 0.05
DARK = 0.05  # value below which a saturation is noise


class ImageBlobs(NamedTuple):
    """Gaussians of one image.

    Args:
        means: (I, 2) on the normalised image plane, without distortion.
        sigmas: (I,) on that plane.
        colours: (I, 3), see `colours_of`.
    """

    means: Array
    sigmas: Array
    colours: Array

    def chosen(self, which: Array) -> ImageBlobs:
        """Return some of the blobs."""
        return ImageBlobs(self.means[which], self.sigmas[which], self.colours[which])


def image_blobs(image: Array, camera: Camera) -> ImageBlobs:
    """Return the blobs of an image (H, W, 3) uint8, BGR."""
    small, step = reduced(image)
    corners, levels, colours = leaves(colours_of(small))
    sides = 2.0**levels
    # the centre of pixel 0 of the reduced image lies between pixels 0 and step - 1 of the image
    pixels = step * (corners + 0.5 * sides[:, None]) - 0.5
    means = camera.intrinsics.undistort(pixels)
    focal = float(np.sqrt(np.prod(np.diag(camera.intrinsics.matrix)[:2])))
    known = np.isfinite(means).all(axis=1)
    blobs = ImageBlobs(means, 0.5 * step * sides / focal, colours)
    return ImageBlobs(*(part.astype(np.float32) for part in blobs.chosen(known)))


def reduced(image: Array) -> tuple[Array, int]:
    """Return an image (h, w, 3) float of at most `MOST_COLUMNS` columns, and the step between its pixels."""
    step = -(-image.shape[1] // MOST_COLUMNS)
    rows, columns = image.shape[0] // step, image.shape[1] // step
    cut = image[: rows * step, : columns * step].astype(np.float32)
    return cut.reshape(rows, step, columns, step, 3).mean(axis=(1, 3)), step


def colours_of(image: Array) -> Array:
    """Return the colours (..., 3) of an image (..., 3), BGR 0..255, as points of the HSV cylinder.

    The points are (s cos h, s sin h, v) with s and v 0..1: the Euclidean distance of two hues then neither
    depends on where the circle of hues begins, nor counts for grey. Shading changes v alone.
    """
    blue, green, red = np.moveaxis(image / 255.0, -1, 0)
    value = np.maximum(np.maximum(blue, green), red)
    chroma = value - np.minimum(np.minimum(blue, green), red)
    saturation = chroma / np.maximum(value, DARK)
    across, up = red - 0.5 * (green + blue), 0.5 * np.sqrt(3.0) * (green - blue)
    length = np.maximum(np.hypot(across, up), 1e-9)
    return np.stack([saturation * across / length, saturation * up / length, value], axis=-1)


def leaves(colours: Array) -> tuple[Array, Array, Array]:
    """Return the leaves of the quad tree of colours (h, w, 3).

    Returns:
        corners (I, 2) px of the upper left corners (x, y), levels (I,), whose sides are 2^level px, and mean
            colours (I, 3).
    """
    side = 1 << (LEVELS - 1)
    rows, columns = colours.shape[:2]
    padded = np.pad(colours, ((0, -rows % side), (0, -columns % side), (0, 0)), mode="edge")
    means, squares = [padded], [(padded**2).sum(axis=-1)]
    for _ in range(LEVELS - 1):
        means.append(_halved(means[-1]))
        squares.append(_halved(squares[-1][..., None])[..., 0])
    found = []
    split = np.ones(means[-1].shape[:2], bool)
    for level in range(LEVELS - 1, LEAST_LEVEL - 1, -1):
        variance = squares[level] - (means[level] ** 2).sum(axis=-1)
        uneven = variance > SPREAD**2 if level > LEAST_LEVEL else np.zeros(split.shape, bool)
        y, x = np.nonzero(split & ~uneven)
        found.append((np.column_stack([x, y]) << level, np.full(len(x), level), means[level][y, x]))
        split = np.repeat(np.repeat(split & uneven, 2, axis=0), 2, axis=1)
    corners, levels, own = (np.concatenate(parts) for parts in zip(*found))
    inside = (corners[:, 0] < columns) & (corners[:, 1] < rows)
    return corners[inside], levels[inside], own[inside]


def _halved(values: Array) -> Array:
    """Return the means (h / 2, w / 2, N) over squares of 2 x 2."""
    rows, columns = values.shape[:2]
    halves: Array = values.reshape(rows // 2, 2, columns // 2, 2, -1).mean(axis=(1, 3))
    return halves
