"""Image regions that the network runs on: one per group of overlapping people, at the scale they need.

The cost of a network grows with the number of pixels. People fill a small part of an image, and their
positions are known from the previous instant. Regions with a scale of their own cost half as much as whole
images. People who overlap share one region, because a network that sees half of a second person in a cut
reports an extra person.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

Array = np.ndarray
MARGIN = 0.10  # margin round the joints, share of a person's height
ABOVE = 0.05  # extra margin above, share of the height: the top of the head is not a joint
LEAST_SCALE = 0.9  # least scale of a region, relative to the scale that suits its people
LEAST_SHARE = 0.15  # least share of a person's box that must lie in the image
SIGMAS = 1.5  # margin for prediction errors, in standard deviations


@dataclass(frozen=True)
class Region:
    """Part of an image, and the size of the network input for it.

    Args:
        box: Left, top, right, bottom px; right and bottom are exclusive.
        net_size: (height, width) px of the network input.
    """

    box: tuple[int, int, int, int]
    net_size: tuple[int, int]

    @property
    def cost(self) -> int:
        """Return the number of pixels of the network input."""
        return self.net_size[0] * self.net_size[1]


def person_boxes(
    pixels: Array, there: Array, doubts: Array, image_size: tuple[int, int]
) -> tuple[Array, Array, Array]:
    """Return the boxes of those of P people who are in the image.

    Args:
        pixels: (P, J, 2) px of the joints.
        there: (P, J) which joints are known and in front of the camera.
        doubts: (P,) px, standard deviation of the positions.

    Returns:
        boxes (N, 4) px clipped to the image, heights (N,) px, and indices (N,) of the people.
    """
    limits = np.array(image_size, float)
    low = np.where(there[..., None], pixels, np.inf).min(axis=1, initial=np.inf)
    high = np.where(there[..., None], pixels, -np.inf).max(axis=1, initial=-np.inf)
    people = np.flatnonzero(there.any(axis=1))
    low, high = low[people], high[people]
    heights = (high - low).max(axis=1, initial=0.0)
    margins = (MARGIN * heights + SIGMAS * doubts[people])[:, None]
    above = np.stack([np.zeros(len(people)), ABOVE * heights], axis=1)
    low, high = low - margins - above, high + margins
    first, last = np.clip(low, 0.0, limits), np.clip(high, 0.0, limits)
    shown = (last - first).prod(axis=1) > np.maximum(LEAST_SHARE * (high - low).prod(axis=1), 0.0)
    return np.concatenate([first, last], axis=1)[shown], heights[shown], people[shown]


@dataclass(frozen=True, eq=False)
class PeopleGroup:
    """Group of people whose boxes touch.

    Args:
        box: (4,) px, bounding box of their boxes.
        tallest: px, height of the tallest.
        people: Indices of the people.
    """

    box: Array
    tallest: float
    people: tuple[int, ...]

    def joined(self, other: PeopleGroup) -> PeopleGroup:
        """Return the union of both groups."""
        low, high = np.minimum(self.box[:2], other.box[:2]), np.maximum(self.box[2:], other.box[2:])
        return PeopleGroup(
            np.concatenate([low, high]), max(self.tallest, other.tallest), self.people + other.people
        )

    def region(
        self, image_size: tuple[int, int], tallest: float, multiple: int, enlarged: float = 1.0
    ) -> Region:
        """Return the region of the image that shows this group.

        Args:
            tallest: Height (px) of the tallest person in the network input, unless `enlarged` limits the
                scale.
            multiple: Sides of the network input are multiples of it.
            enlarged: Greatest scale, px of the network input per px of the image.
        """
        return _region(self.box, min(enlarged, tallest / max(self.tallest, 1.0)), image_size, multiple)


def groups_of(boxes: Array, heights: Array, people: Array) -> list[PeopleGroup]:
    """Merge people (N,) with boxes (N, 4) px and heights (N,) px into groups with touching boxes."""
    groups = [
        PeopleGroup(box, tall, (who,)) for box, tall, who in zip(boxes, heights.tolist(), people.tolist())
    ]
    merged = True
    while merged:
        merged = False
        for i, group in enumerate(groups):
            one = group.box
            for k in range(i + 1, len(groups)):
                other = groups[k].box
                if (one[:2] <= other[2:]).all() and (other[:2] <= one[2:]).all():
                    groups[i] = group.joined(groups.pop(k))
                    merged = True
                    break
            if merged:
                break
    return groups


def _region(box: Array, scale: float, image_size: tuple[int, int], multiple: int) -> Region:
    """Return a region round a box at about the given scale, enlarged until the input's sides fit `multiple`.

    The enlargement shows more of the image round the box. A slightly lower scale can avoid rounding a side
    up. The function takes the scale with the fewest input pixels at equal
    resolution.
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
