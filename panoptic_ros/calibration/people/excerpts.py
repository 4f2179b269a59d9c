"""Parts of a recording in which people walk most, and the instants of an adjustment in them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from panoptic_ros.calibration.people.tracklets import FEWEST_FRAMES, Tracklet

Array = np.ndarray
SEGMENT_S = 5.0  # s, length of a part
MOST_SEGMENTS = 6  # parts, half a minute: more change errors by little and cost time
SPARSE_HZ = 10.0  # Hz, instants of essential matrices and identities; people move 0.1 m between them


class Excerpt(NamedTuple):
    """Parts of a recording.

    Args:
        tracklets: Tracklets within the parts.
        dense: (K,) s, instants of the adjustment: stamps of the camera with most frames.
        sparse: (L,) s, fewer of them.
    """

    tracklets: list[Tracklet]
    dense: Array
    sparse: Array


def excerpt_of(tracklets: Sequence[Tracklet], cameras: int) -> Excerpt:
    """Return the parts of a recording in which people travel most in the images."""
    last = max(float(own.stamps[-1]) for own in tracklets)
    count = max(1, round(last / SEGMENT_S))
    edges = np.linspace(0.0, last, count + 1)
    edges[-1] += 1.0
    parts = []
    for first, end in pairwise(edges):
        pieces = [own.cut(first, end) for own in tracklets]
        parts.append([own for own in pieces if len(own.stamps) >= FEWEST_FRAMES])
    travel = np.array([sum(own.travel for own in part) for part in parts])
    best = np.sort(np.argsort(-travel, kind="stable")[:MOST_SEGMENTS])
    chosen = [own for k in best for own in parts[k]]
    stamps = [
        np.unique(np.concatenate([own.stamps for own in chosen if own.camera == c] or [[]]))
        for c in range(cameras)
    ]
    dense = max(stamps, key=len)
    step = float(np.median(np.diff(dense)))
    every = max(1, round(1.0 / (SPARSE_HZ * step)))
    return Excerpt(chosen, dense, dense[::every])
