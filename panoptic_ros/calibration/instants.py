"""Group images of cameras that are not synchronised into instants."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

Array = np.ndarray
SPREAD = 0.6  # longest time from the first to the last image of an instant, over the median period


def instants_of(cameras: Array, stamps: Array) -> Array:
    """Return the number of the instant (N,) of each image, from 0, given cameras (N,) and stamps (N,) s.

    Images are taken in order of time. An instant ends where a camera repeats, or where a share of the slowest
    camera's period has passed since its first image.
    """
    longest = _period(cameras, stamps) * SPREAD
    numbers = np.zeros(len(stamps), np.int64)
    first, own, number = -np.inf, set[int](), -1
    for k in np.argsort(stamps, kind="stable"):
        if cameras[k] in own or stamps[k] - first > longest:
            first, own, number = stamps[k], set(), number + 1
        own.add(int(cameras[k]))
        numbers[k] = number
    return numbers


def _period(cameras: Array, stamps: Array) -> float:
    """Return the median period, s, of the slowest camera; 0 if no camera has two images."""
    gaps = [np.diff(np.sort(stamps[cameras == c])) for c in np.unique(cameras)]
    medians: Sequence[float] = [float(np.median(gap)) for gap in gaps if len(gap)]
    return max(medians, default=0.0)
