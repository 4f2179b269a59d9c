"""Conversion of images to network inputs, with the exact affine map between their pixels.

All maps use pixel coordinates with the origin at the centre of the first pixel, as in OpenCV.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from panoptic_ros.detection.card import CoordsCard, InputCard

Array = np.ndarray


LEAST_LINEAR = 0.5  # scale from which bilinear sampling reads every pixel, at a seventh of the cost
BLURRED = 1000  # px, longer side above which bilinear rotation suffices: later shrinking hides its blur
QUARTER_TURNS = (cv2.ROTATE_90_COUNTERCLOCKWISE, cv2.ROTATE_180, cv2.ROTATE_90_CLOCKWISE)  # 1, 2, 3 turns


def letterbox(
    image: Array, size: tuple[int, int], card: InputCard, quick: bool = False
) -> tuple[Array, Array]:
    """Fit an image into (height, width), keeping its aspect ratio; return it and net_from_image (2, 3).

    The two axes have separate scales, because the fitted sizes are whole pixels.

    Args:
        quick: Sample bilinearly down to half the size, instead of averaging over areas.
    """
    height, width = image.shape[:2]
    scale = min(size[0] / height, size[1] / width)
    rows = min(max(round(height * scale), 1), size[0])
    columns = min(max(round(width * scale), 1), size[1])
    areas = scale < (LEAST_LINEAR if quick else 1.0)
    sampling = cv2.INTER_AREA if areas else cv2.INTER_LINEAR
    fitted = cv2.resize(image, (columns, rows), interpolation=sampling)
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
    """Cut out the surroundings of a box (left, top, right, bottom); return them and net_from_image (2, 3).

    The box is enlarged by the card's padding and to the aspect ratio of the input. As in MMPose
    (TopdownAffine), its left edge lies at px 0 of the input and its right edge at w, or at w - 1 with UDP.
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
        image,
        affine,
        (width, height),
        flags=cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=border,
    )
    return patch, affine


def input_tensor(images: Sequence[Array], card: InputCard) -> Array:
    """Return the input tensor of N images (H, W, 3) uint8 BGR that have the size of the network input."""
    if card.color == "RGB":
        images = [cv2.cvtColor(image, cv2.COLOR_BGR2RGB) for image in images]  # much faster than in numpy
    batch = np.stack(images) if len(images) > 1 else images[0][None]
    if card.mean != (0.0, 0.0, 0.0) or card.std != (1.0, 1.0, 1.0):
        mean, std = np.array(card.mean, np.float32), np.array(card.std, np.float32)
        batch = (batch.astype(np.float32) - mean) / std
    if card.layout == "NCHW":
        batch = batch.transpose(0, 3, 1, 2)
    return np.ascontiguousarray(batch, dtype=card.dtype)


@dataclass(frozen=True, eq=False)
class ImageRotation:
    """Rotation from px of a camera's image to px of the upright image, which contains the whole image.

    Args:
        degrees: Rotation, counter-clockwise.
        size: (width, height) px of the upright image.
        upright_from_image: (2, 3) affine map.
        enlarged: Ratio of the longer side of the upright image to that of the camera's image.
    """

    degrees: float
    size: tuple[int, int]
    upright_from_image: Array
    enlarged: float

    def image(self, image: Array, pad: int) -> Array:
        """Rotate an image (H, W, 3) uint8; quarter turns copy all pixels without resampling.

        Args:
            pad: Grey value beyond the borders of the image.
        """
        quarters, rest = divmod(self.degrees, 90.0)
        sampling = cv2.INTER_CUBIC if max(image.shape) <= BLURRED else cv2.INTER_LINEAR
        turned: Array
        if rest == 0.0:
            turned = cv2.rotate(image, QUARTER_TURNS[int(quarters) % 4 - 1])
        else:
            turned = cv2.warpAffine(
                image,
                self.upright_from_image,
                self.size,
                flags=sampling,
                borderMode=cv2.BORDER_CONSTANT,
                borderValue=(pad,) * 3,
            )
        return turned

    def pixels(self, points: Array) -> Array:
        """Map points (..., 2) of the image to the upright image."""
        return moved(points, self.upright_from_image)

    def back(self, points: Array) -> Array:
        """Map points (..., 2) of the upright image back to the image."""
        return moved(points, inverted(self.upright_from_image))


@lru_cache(maxsize=1024)
def turn_by(degrees: float, image_size: tuple[int, int]) -> ImageRotation:
    """Return the rotation of images (width, height) px by `degrees` counter-clockwise."""
    angle = math.radians(degrees)
    cosine, sine = math.cos(angle), math.sin(angle)
    if degrees % 90.0 == 0.0:  # exact sine and cosine
        cosine, sine = float(round(cosine)), float(round(sine))
    turn = np.array([[cosine, sine], [-sine, cosine]])
    width, height = np.ceil(np.abs(turn) @ image_size - 1e-6).astype(int).tolist()
    middle, centre = np.array([width - 1, height - 1]) / 2.0, (np.array(image_size) - 1) / 2.0
    affine = np.column_stack([turn, middle - turn @ centre])
    return ImageRotation(degrees, (width, height), affine, max(width, height) / max(image_size))


def moved(points: Array, affine: Array) -> Array:
    """Map points (..., 2) by a (2, 3) affine map."""
    places: Array = points @ affine[:, :2].T + affine[:, 2]
    return places


def inverted(affine: Array) -> Array:
    """Return the inverse of a (2, 3) affine map."""
    (a, b, x), (c, d, y) = affine.tolist()
    det = a * d - b * c
    a, b, c, d = d / det, -b / det, -c / det, a / det
    return np.array([[a, b, -(a * x + b * y)], [c, d, -(c * x + d * y)]])


def composed(outer: Array, inner: Array) -> Array:
    """Return the (2, 3) affine map that applies `inner`, then `outer`."""
    (a, b, x), (c, d, y) = outer.tolist()
    (e, f, u), (g, h, v) = inner.tolist()
    return np.array(
        [
            [a * e + b * g, a * f + b * h, a * u + b * v + x],
            [c * e + d * g, c * f + d * h, c * u + d * v + y],
        ]
    )
