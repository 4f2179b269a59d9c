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
) -> tuple[Array, Array, Array]:
    """Boxes (N, 4) px of the image that show those of P people who are in it, their heights (N,) px, and who
    they are (N,).

    Args:
        pixels: (P, J, 2) of the joints. there: (P, J) which of them are known and before the camera.
        doubts: (P,) px, standard deviation of where they are.
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
class Group:
    """People whose boxes touch: a box (4,) px round these, the height px of the tallest, and who they are."""

    box: Array
    tallest: float
    people: tuple[int, ...]

    def joined(self, other: Group) -> Group:
        """Both as one."""
        low, high = np.minimum(self.box[:2], other.box[:2]), np.maximum(self.box[2:], other.box[2:])
        return Group(
            np.concatenate([low, high]), max(self.tallest, other.tallest), self.people + other.people
        )

    def region(
        self, image_size: tuple[int, int], tallest: float, multiple: int, enlarged: float = 1.0
    ) -> Region:
        """Where to look for them.

        Args:
            tallest: net px that the tallest has; the image is enlarged so much at most.
            multiple: sides of the network's input are multiples of it.
        """
        return _region(self.box, min(enlarged, tallest / max(self.tallest, 1.0)), image_size, multiple)


def groups_of(boxes: Array, heights: Array, people: Array) -> list[Group]:
    """Groups of people (N,) with boxes (N, 4) px and heights (N,) px."""
    groups = [Group(box, tall, (who,)) for box, tall, who in zip(boxes, heights.tolist(), people.tolist())]
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
