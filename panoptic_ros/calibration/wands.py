"""Wand of two to four bright markers: its specification, and the markers in images."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import cv2
import numpy as np

from panoptic_ros.calibration.boards import UNITS
from panoptic_ros.errors import UsageError, shown

Array = np.ndarray
FEWEST, MOST = 2, 4  # markers
SPECIFICATION = re.compile(r"wand:(?P<markers>[-0-9.,/]+)(?P<unit>[a-z]+)")
EXAMPLES = "wand:500mm (two markers), wand:0/150/500mm (three on a stick), wand:0,0/250,0/500,0/250,-200mm (x,y)"
SHORTEST_M = 0.02  # m, least distance of two markers
BRIGHT = 200  # grey value of markers, which glow or reflect
AREA_PX = (2, 4000)  # px^2, of a marker
FULLEST = 0.4  # least share of its box that a round marker fills
LONGEST = 3.0  # greatest ratio of the sides of that box
STILL_PX = 3.0  # px, distance between images within which a bright spot stays in place
STILL_SHARE = 0.3  # share of the images in which a lamp is at one place


@dataclass(frozen=True)
class Wand:
    """Wand with markers at known positions.

    Args:
        markers: (x, y) m of each marker, in one plane.

    Raises:
        UsageError: on a wrong number of markers, or on two markers at one place.
    """

    markers: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        if not FEWEST <= len(self.markers) <= MOST:
            raise UsageError(f"a wand of {len(self.markers)} markers; give {FEWEST} to {MOST}")
        apart = np.linalg.norm(self.points[:, None] - self.points[None], axis=2)
        if apart[np.triu_indices(len(apart), 1)].min() < SHORTEST_M:
            raise UsageError(f"two markers of the wand are closer than {1e3 * SHORTEST_M:g} mm")

    @property
    def points(self) -> Array:
        """Return the markers (N, 3) m, in the plane z = 0."""
        return np.array([(x, y, 0.0) for x, y in self.markers])

    @property
    def name(self) -> str:
        """Return the kind of the target."""
        return "wand"


def parse_wand(text: str) -> Wand:
    """Return the wand of a specification such as `wand:0/150/500mm`.

    Raises:
        UsageError: naming the part that is wrong.
    """
    found = SPECIFICATION.fullmatch(text.strip())
    if not found or found["unit"] not in UNITS:
        raise UsageError(f"wand {shown(text)} is not understood; examples: {EXAMPLES}")
    entries = found["markers"].split("/")
    if len(entries) == 1 and "," not in entries[0]:
        entries = ["0", *entries]
    try:
        pairs = [tuple(float(word) for word in entry.split(",")) for entry in entries]
    except ValueError:
        raise UsageError(f"wand {shown(text)}: positions must be numbers; examples: {EXAMPLES}") from None
    if any(len(pair) > 2 for pair in pairs):
        raise UsageError(f"wand {shown(text)}: a marker has x, or x,y; examples: {EXAMPLES}")
    unit = UNITS[found["unit"]]
    return Wand(tuple((unit * pair[0], unit * pair[1] if len(pair) > 1 else 0.0) for pair in pairs))


def bright_spots(image: Array) -> Array:
    """Return the centres (K, 2) px of round bright spots in a grey image (H, W) uint8."""
    mask = (image >= BRIGHT).astype(np.uint8)
    count, labels, boxes, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    spots = []
    for k in range(1, count):
        x, y, width, height, area = boxes[k]
        if not AREA_PX[0] <= area <= AREA_PX[1]:
            continue
        if area < FULLEST * width * height or max(width, height) > LONGEST * min(width, height):
            continue
        rows, columns = slice(max(y - 1, 0), y + height + 1), slice(max(x - 1, 0), x + width + 1)
        foreign = (labels[rows, columns] != k) & (labels[rows, columns] != 0)
        weight = np.where(foreign, 0.0, image[rows, columns].astype(np.float64))  # the dim rim refines the centre
        down, across = np.mgrid[rows, columns]
        total = weight.sum()
        spots.append(((weight * across).sum() / total, (weight * down).sum() / total))
    return np.array(spots).reshape(-1, 2)


def without_lamps(spots: Sequence[Array]) -> list[Array]:
    """Return the spots (K, 2) px of each image of a camera, without those that stay at one place."""
    every = np.concatenate([*spots, np.zeros((0, 2))])
    if not len(every):
        return list(spots)
    found = []
    for own in spots:
        near = np.linalg.norm(own[:, None] - every[None], axis=2) < STILL_PX
        found.append(own[near.sum(axis=1) <= max(2.0, STILL_SHARE * len(spots))])
    return found


def in_wand_order(wand: Wand, spots: Array) -> Array:
    """Return spots (N, 2) px in the order of the N markers.

    Of all orders, an affine map from the wand to the image fits best in the right one. The order of a wand that
    looks the same from both ends is open.
    """
    points = wand.points[:, :2]
    across = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    flat = np.column_stack([np.ones(len(points)), points])
    if across[1][-1] < 1e-6:  # all markers on a line
        flat = np.column_stack([np.ones(len(points)), points @ across[2][0]])
    fitted = flat @ np.linalg.pinv(flat)
    orders = [list(order) for order in permutations(range(len(points)))]
    misses = [np.square(spots[order] - fitted @ spots[order]).sum() for order in orders]
    chosen: Array = spots[orders[int(np.argmin(misses))]]
    return chosen
