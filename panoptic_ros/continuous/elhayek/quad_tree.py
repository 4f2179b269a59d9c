"""Image blobs: leaves of a quad tree of an image as Gaussians with a colour (paper, 4; Stoll et al. 2011).

A square whose colours spread more than a threshold is split into four. A leaf becomes a Gaussian at its
centre; its standard deviation is half of its side.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from panoptic_ros.domain import Camera

Array = np.ndarray
COLUMNS = 320  # px, width to which larger images are reduced; the paper's have 162
LEVELS = 5  # sides of squares: 1, 2, ... 16 px of the reduced image
LEAST_LEVEL = 1  # leaves have at least 2 px per side: single pixels are mostly noise
# Root mean square distance from the mean colour of a square, above which it is split. A large value merges
# limbs with a similar background.
SPREAD = 0.05
DARK = 0.05  # value below which the saturation is mostly noise


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


def image_blobs(image: Array, camera: Camera) -> ImageBlobs:
    """Return the blobs of an image (H, W, 3) uint8, BGR."""
    height, width = image.shape[:2]
    columns = min(COLUMNS, width)
    rows = max(1, round(height * columns / width))
    scale = np.array([width / columns, height / rows])
    small = cv2.resize(image, (columns, rows), interpolation=cv2.INTER_AREA)
    corners, levels, colours = leaves(colours_of(small))
    sides = 2.0**levels
    # the centre of a pixel has integer coordinates
    means = camera.intrinsics.undistort(scale * (corners + 0.5 * sides[:, None]) - 0.5)
    focal = float(np.sqrt(np.prod(np.diag(camera.intrinsics.matrix)[:2])))
    known = np.isfinite(means).all(axis=1)
    parts = (means, 0.5 * scale[0] * sides / focal, colours)
    return ImageBlobs(*(part[known].astype(np.float32) for part in parts))


def colours_of(image: Array) -> Array:
    """Return the colours (..., 3) of an image (H, W, 3) uint8, BGR, as points of the HSV cylinder.

    The points are (s cos h, s sin h, v) with s and v 0..1. Their distance does not depend on where the circle
    of hues begins, and the hue of grey does not count. Shading changes v alone.
    """
    pixels = image.astype(np.float32) / 255.0
    hue, saturation, value = np.moveaxis(cv2.cvtColor(pixels, cv2.COLOR_BGR2HSV), -1, 0)
    saturation = saturation * np.minimum(value / DARK, 1.0)
    angle = np.radians(hue)
    return np.stack([saturation * np.cos(angle), saturation * np.sin(angle), value], axis=-1)


def leaves(colours: Array) -> tuple[Array, Array, Array]:
    """Return the leaves of the quad tree of colours (h, w, 3).

    Returns:
        corners (I, 2) px of the upper left corners (x, y), levels (I,), whose sides are 2^level px, and mean
            colours (I, 3).
    """
    side = 1 << (LEVELS - 1)
    rows, columns = colours.shape[:2]
    padded = np.pad(colours, ((0, -rows % side), (0, -columns % side), (0, 0)), mode="edge")
    means, squares = [padded], [(padded**2).sum(axis=-1, keepdims=True)]
    for _ in range(LEVELS - 1):
        means.append(_halved(means[-1]))
        squares.append(_halved(squares[-1]))
    found = []
    split = np.ones(means[-1].shape[:2], bool)
    for level in range(LEVELS - 1, LEAST_LEVEL - 1, -1):
        variance = squares[level][..., 0] - (means[level] ** 2).sum(axis=-1)
        uneven = split & (variance > SPREAD**2) & (level > LEAST_LEVEL)
        y, x = np.nonzero(split & ~uneven)
        found.append((np.column_stack([x, y]) << level, np.full(len(x), level), means[level][y, x]))
        split = np.repeat(np.repeat(uneven, 2, axis=0), 2, axis=1)
    corners, levels, own = (np.concatenate(parts) for parts in zip(*found))
    inside = (corners < (columns, rows)).all(axis=1)
    return corners[inside], levels[inside], own[inside]


def _halved(values: Array) -> Array:
    """Return the means (h / 2, w / 2, N) of values (h, w, N) over squares of 2 x 2."""
    rows, columns = values.shape[:2]
    halves: Array = values.reshape(rows // 2, 2, columns // 2, 2, -1).mean(axis=(1, 3))
    return halves
