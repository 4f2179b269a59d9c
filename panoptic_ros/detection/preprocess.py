"""Images into network inputs, with the exact affine map between their pixels.

All maps are between pixels told from the centre of the first pixel, as in OpenCV.
"""
from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from panoptic_ros.detection.area import shrunk
from panoptic_ros.detection.card import CoordsCard, InputCard

Array = np.ndarray


LEAST_LINEAR = 0.5  # scale from which on bilinear sampling reads every pixel, at a seventh of the cost


def letterbox(
    image: Array, size: tuple[int, int], card: InputCard, quick: bool = False
) -> tuple[Array, Array]:
    """An image fitted into (height, width) keeping its shape, and net_from_image (2, 3).

    The two axes have their own scale, as the fitted sizes are whole pixels.

    Args:
        quick: bilinear down to half of the size, in place of the mean over areas.
    """
    height, width = image.shape[:2]
    scale = min(size[0] / height, size[1] / width)
    rows = min(max(round(height * scale), 1), size[0])
    columns = min(max(round(width * scale), 1), size[1])
    if scale < (LEAST_LINEAR if quick else 1.0):
        fitted = shrunk(image, (rows, columns))
    else:
        fitted = cv2.resize(image, (columns, rows), interpolation=cv2.INTER_LINEAR)
    sx, sy = columns / width, rows / height
    if (rows, columns) == size:
        return fitted, np.array([[sx, 0.0, 0.5 * sx - 0.5], [0.0, sy, 0.5 * sy - 0.5]])
    top = left = 0
    if card.fit == "letterbox_center":
        top, left = (size[0] - rows) // 2, (size[1] - columns) // 2
    canvas = np.full((*size, 3), card.pad, np.uint8)
    canvas[top : top + rows, left : left + columns] = fitted
    return canvas, np.array([[sx, 0.0, left + 0.5 * sx - 0.5], [0.0, sy, top + 0.5 * sy - 0.5]])


def crop(image: Array, box: Array, card: InputCard, coords: CoordsCard) -> tuple[Array, Array]:
    """The surroundings of a box (left, top, right, bottom), and net_from_image (2, 3).

    The box is enlarged by the card's padding and to the shape of the input. As in MMPose
    (TopdownAffine): its left edge lies at net px 0 and its right edge at w, or w - 1 with UDP.
    """
    height, width = card.size
    centre = 0.5 * (box[:2] + box[2:])
    sides = np.maximum(box[2:] - box[:2], 1.0) * card.crop_padding
    extent = np.array([max(sides[0], sides[1] * width / height), 0.0])
    extent[1] = extent[0] * height / width
    target = np.array([width, height]) - (1.0 if coords.udp else 0.0)
    scale = target / extent
    shift = 0.5 * target - scale * centre
    affine = np.array([[scale[0], 0.0, shift[0]], [0.0, scale[1], shift[1]]])
    border = (card.pad,) * 3
    patch = cv2.warpAffine(
        image, affine, (width, height), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT,
        borderValue=border,
    )  # fmt: skip
    return patch, affine


def input_tensor(images: Sequence[Array], card: InputCard) -> Array:
    """The network's input of N images (H, W, 3) uint8 BGR of its size."""
    if card.color == "RGB":
        images = [cv2.cvtColor(image, cv2.COLOR_BGR2RGB) for image in images]  # much quicker than numpy
    batch = np.stack(images) if len(images) > 1 else images[0][None]
    if card.mean != (0.0, 0.0, 0.0) or card.std != (1.0, 1.0, 1.0):
        mean, std = np.array(card.mean, np.float32), np.array(card.std, np.float32)
        batch = (batch.astype(np.float32) - mean) / std
    if card.layout == "NCHW":
        batch = batch.transpose(0, 3, 1, 2)
    return np.ascontiguousarray(batch, dtype=card.dtype)


def inverted(affine: Array) -> Array:
    """The inverse of a (2, 3) affine map."""
    (a, b, x), (c, d, y) = affine.tolist()
    det = a * d - b * c
    a, b, c, d = d / det, -b / det, -c / det, a / det
    return np.array([[a, b, -(a * x + b * y)], [c, d, -(c * x + d * y)]])


def composed(outer: Array, inner: Array) -> Array:
    """The (2, 3) affine map that applies `inner`, then `outer`."""
    (a, b, x), (c, d, y) = outer.tolist()
    (e, f, u), (g, h, v) = inner.tolist()
    return np.array([
        [a * e + b * g, a * f + b * h, a * u + b * v + x], [c * e + d * g, c * f + d * h, c * u + d * v + y],
    ])  # fmt: skip
