"""2D people carried from image to image by optical flow, where the network does not look.

A joint that does not come back to where it began is lost, see `geometry.optical_flow`. Over 100 ms a carried
joint is off by 0.8 % of the person's height; the network itself by 1.8 %.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from panoptic_ros.detection.people import People, no_people
from panoptic_ros.geometry.optical_flow import there_and_back

Array = np.ndarray
WIDTH, COARSE = 320, 40  # px, of the grey images: where people are carried, and where cuts are told alone
ITERATIONS = 12  # of flow per level
RETURN = 1.0  # px of the grey image, by which a joint may miss its beginning
FEWEST = 3  # joints that a carried person has
KEPT = 0.4  # of the joints that must come along; of fewer, the image is another
CUT_LEVELS = 30.0  # mean difference of grey values between two images of different scenes


@dataclass(frozen=True, eq=False)
class Memory:
    """An image as flow needs it, and the people in it.

    Args:
        grey: (h, w) uint8. scale: px of the image per px of it.
        people: in px of the image, or None if nobody carries them on.
        stamp_ns: of the image. look_ns: of the image in which the network saw the people.
    """

    grey: Array
    scale: float
    stamp_ns: int
    people: People | None = None
    look_ns: int = 0


def remembered(image: Array, stamp_ns: int, wide: int = WIDTH) -> Memory:
    """An image (H, W, 3) uint8 BGR, made grey and small: at most so `wide`, px."""
    height, width = image.shape[:2]
    shrink = max(1.0, width / wide)
    # first smaller, then grey: a quarter of the pixels to convert
    method = cv2.INTER_AREA if shrink == 2.0 else cv2.INTER_LINEAR
    small = cv2.resize(image, (round(width / shrink), max(round(height / shrink), 1)), interpolation=method)
    return Memory(cv2.cvtColor(small, cv2.COLOR_BGR2GRAY), width / small.shape[1], stamp_ns)


def is_cut(before: Memory, now: Memory) -> bool:
    """Whether two images are of different scenes."""
    if before.grey.shape != now.grey.shape:
        return True
    step = max(1, before.grey.shape[1] // COARSE)
    one, other = before.grey[::step, ::step], now.grey[::step, ::step]
    return float(np.abs(one.astype(np.int16) - other).mean()) > CUT_LEVELS


def carried(before: Memory, now: Memory) -> People | None:
    """The people of an image where they are in the next one; None if they cannot be followed."""
    people = before.people
    if people is None or before.grey.shape != now.grey.shape:
        return None
    if not len(people):
        return people
    there = people.scores > 0.0
    points = _small(people.points[there], before.scale)
    if not len(points):
        return no_people(people.scores.shape[1])
    moved, kept = _followed(before.grey, now.grey, points)
    if kept.mean() < KEPT:
        return None
    places, scores = people.points.copy(), np.zeros_like(people.scores)
    places[there] = np.where(kept[:, None], _large(moved, now.scale), places[there])
    scores[there] = np.where(kept, people.scores[there], 0.0)
    rows = np.flatnonzero((scores > 0.0).sum(axis=1) >= np.minimum(FEWEST, there.sum(axis=1)))
    return replace(people, points=places, scores=scores).select(rows)


def _followed(before: Array, now: Array, points: Array) -> tuple[Array, Array]:
    """Where points (N, 2) px of an image are in the next one, and which of them come back (N,)."""
    moved, missed, found = there_and_back(before, now, points, points, ITERATIONS, back_from_begins=False)
    height, width = now.shape
    inside = (moved >= 0.0).all(axis=1) & (moved < (width, height)).all(axis=1)
    return moved.astype(np.float64), found & (missed <= RETURN) & inside


def _small(points: Array, scale: float) -> Array:
    """Px of the image as px of the grey one; both told from the centre of the first."""
    return (points + 0.5) / scale - 0.5


def _large(points: Array, scale: float) -> Array:
    return (points + 0.5) * scale - 0.5
