"""Where to look in an image: one region for each group of people who overlap, at the scale that it needs.

A network costs by the pixel. People fill a small part of an image, and where they are is known from the
instant before. Groups of their own scale cost half of whole images; people who overlap stay together, as a
network that sees half of a second person in a cut finds a person too many.
"""
from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

Array = np.ndarray
MARGIN = 0.10  # of a person's height, round the joints
ABOVE = 0.05  # more above: the top of the head is no joint
LEAST_SCALE = 0.9  # of the scale that suits the people
LEAST_SHARE = 0.15  # of a person's box that must lie in the image
SIGMAS = 1.5  # of what a prediction may be off


@dataclass(frozen=True)
class Region:
    """A part of an image, and the size of the network's input for it.

    Args:
        box: left, top, right, bottom px; the last two are not part of it.
        net_size: (height, width) net px.
    """

    box: tuple[int, int, int, int]
    net_size: tuple[int, int]

    @property
    def cost(self) -> int:
        """Net px."""
        return self.net_size[0] * self.net_size[1]


def person_boxes(
    pixels: Array, there: Array, doubts: Array, image_size: tuple[int, int]
) -> tuple[Array, Array]:
    """Boxes (N, 4) px of the image that show those of P people who are in it, and their heights (N,) px.

    Args:
        pixels: (P, J, 2) of the joints. there: (P, J) which of them are known and before the camera.
        doubts: (P,) px, standard deviation of where they are.
    """
    width, height = image_size
    boxes, heights = [], []
    for points, known, doubt in zip(pixels, there, doubts):
        if not known.any():
            continue
        low, high = points[known].min(axis=0), points[known].max(axis=0)
        tall = float((high - low).max())
        margin = MARGIN * tall + SIGMAS * doubt
        low, high = low - margin - (0.0, ABOVE * tall), high + margin
        area = float(np.prod(high - low))
        left, top = np.clip(low, 0.0, (width, height))
        right, bottom = np.clip(high, 0.0, (width, height))
        if (right - left) * (bottom - top) > LEAST_SHARE * area > 0.0:
            boxes.append((left, top, right, bottom))
            heights.append(tall)
    return np.array(boxes).reshape(-1, 4), np.array(heights)


def regions_of(
    boxes: Array, heights: Array, image_size: tuple[int, int], tallest: float, multiple: int
) -> list[Region]:
    """One region for each group of boxes (N, 4) px that touch, of people of heights (N,) px.

    Args:
        tallest: net px that the tallest person of a group has; images are never enlarged.
        multiple: sides of the network's input are multiples of it.
    """
    return [
        _region(box, min(1.0, tallest / max(tall, 1.0)), image_size, multiple)
        for box, tall in _groups(boxes, heights)
    ]


def _groups(boxes: Array, heights: Array) -> list[tuple[Array, float]]:
    """Boxes round groups of boxes that touch, and the largest height in each."""
    groups = list(zip(boxes, heights.tolist()))
    merged = True
    while merged:
        merged = False
        for i, (one, tall) in enumerate(groups):
            for k in range(i + 1, len(groups)):
                other = groups[k][0]
                if (one[:2] <= other[2:]).all() and (other[:2] <= one[2:]).all():
                    both = np.concatenate([np.minimum(one[:2], other[:2]), np.maximum(one[2:], other[2:])])
                    groups[i] = (both, max(tall, groups[k][1]))
                    del groups[k]
                    merged = True
                    break
            if merged:
                break
    return groups


def _region(box: Array, scale: float, image_size: tuple[int, int], multiple: int) -> Region:
    """A box at about a scale, enlarged by what the image has round it until the input's sides are multiples.

    The scale may be lower by a little, where sides then need not be rounded up so far: the one that costs the
    fewest net px at equal resolution is taken.
    """
    extent = box[2:] - box[:2]
    low = [max(math.floor(side * LEAST_SCALE * scale / multiple), 1) for side in extent]
    high = [max(math.ceil(round(side * scale, 6) / multiple), 1) for side in extent]
    best, best_cost, size = scale, math.inf, (high[0], high[1])
    for columns in range(low[0], high[0] + 1):
        for rows in range(low[1], high[1] + 1):
            fitting = min(scale, multiple * columns / extent[0], multiple * rows / extent[1])
            cost = columns * rows / fitting**2
            if fitting >= LEAST_SCALE * scale and cost < best_cost:
                best, best_cost, size = fitting, cost, (columns, rows)
    edges = []
    for side, first, last, limit in zip(size, box[:2], box[2:], image_size):
        wanted = min(side * multiple / best, limit)  # px of the image
        begin = math.floor(min(max(0.5 * (first + last - wanted), 0.0), limit - wanted))
        edges.append((begin, min(math.ceil(begin + wanted - 1e-6), limit)))
    (left, right), (top, bottom) = edges
    return Region((left, top, right, bottom), (size[1] * multiple, size[0] * multiple))
