"""The loops of the conditioning, compiled."""
from __future__ import annotations

from functools import lru_cache

import numpy as np
from numba import njit

Array = np.ndarray
EVERY = 7  # th sample tells the level; no multiple of a half cell's length
_jit = njit(cache=True, error_model="numpy", nogil=True)


@_jit
def piece_levels(signal: Array, piece: int, share: float, every: int) -> Array:
    """The magnitude below which a share of each piece lies, or of a neighbour if that is more."""
    pieces = max(1, len(signal) // piece)
    levels = np.empty(pieces)
    for k in range(pieces):
        end = len(signal) if k == pieces - 1 else (k + 1) * piece
        values = np.sort(np.abs(signal[k * piece : end : every]))
        levels[k] = values[int(share * (len(values) - 1))]
    wide = levels.copy()
    for k in range(pieces):
        wide[k] = max(levels[k], levels[max(0, k - 1)], levels[min(pieces - 1, k + 1)])
    return wide


@_jit
def limit(signal: Array, piece: int, share: float, clip: float, blank: float) -> None:
    """Cut off what is far above the level of its neighbourhood, in place; nought what is farther."""
    levels = piece_levels(signal, piece, share, EVERY)
    for i in range(len(signal)):
        level = levels[min(i // piece, len(levels) - 1)]
        value = abs(signal[i])
        if value > blank * level:
            signal[i] = 0.0
        elif value > clip * level:
            signal[i] = clip * level if signal[i] > 0.0 else -clip * level


@_jit
def bridge_clicks(raw: Array, reach: int, piece: int, share: float, most: float, longest: int) -> Array:
    """The samples with short bursts far above their neighbourhood replaced by straight lines.

    Args:
        reach: samples to both sides whose mean is the baseline.
        longest: samples of a burst; what lasts longer is no click.
    """
    count = len(raw)
    sums = np.empty(count + 1)
    sums[0] = 0.0
    for i in range(count):
        sums[i + 1] = sums[i] + raw[i]
    high = np.empty(count)
    for i in range(count):
        low, top = max(0, i - reach), min(count, i + reach + 1)
        high[i] = raw[i] - (sums[top] - sums[low]) / (top - low)
    levels = piece_levels(high, piece, share, EVERY)
    clean = raw.copy()
    i = 0
    while i < count:
        if abs(high[i]) <= most * levels[min(i // piece, len(levels) - 1)]:
            i += 1
            continue
        end, quiet = i + 1, 0
        while end < count and quiet < 3:
            loud = abs(high[end]) > most * levels[min(end // piece, len(levels) - 1)]
            quiet = 0 if loud else quiet + 1
            end += 1
        end -= quiet
        if end - i <= longest and i > 1 and end + 1 < count:
            left, right = clean[i - 2], raw[end + 1]
            for k in range(i - 1, end + 1):
                clean[k] = left + (right - left) * (k - i + 2.0) / (end - i + 3.0)
        i = end
    return clean


@lru_cache(maxsize=1)
def compile_conditioning() -> None:
    """Compile all of this for the types that it is called with, or take it from numba's cache."""
    limit(np.ones(400), 100, 0.8, 2.0, 3.0)
    bridge_clicks(np.ones(400), 20, 100, 0.8, 2.0, 5)
