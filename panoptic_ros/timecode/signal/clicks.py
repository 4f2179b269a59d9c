"""Find clicks (short bursts far above the signal level) and replace them by straight lines."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.kernels import njit

Array = np.ndarray
_jit = njit(cache=True, error_model="numpy", nogil=True)
EVERY = 7  # the level is computed from every 7th sample; 7 is not a multiple of the half-cell length
TOGETHER = 64  # samples compared per inner loop


class ClickLimits(NamedTuple):
    """Limits that define a click.

    Args:
        reach: (samples) half width of the window whose mean is the baseline of a sample.
        piece: (samples) length of the piece over which one level is computed.
        share: (0..1) quantile of the magnitudes that is taken as the level.
        most: ratio of a magnitude to the level above which a sample belongs to a click.
        longest: (samples) maximum length of a click; longer bursts are kept.
    """

    reach: int
    piece: int
    share: float
    most: float
    longest: int


@_jit
def piece_levels(signal: Array, piece: int, share: float, every: int) -> Array:
    """Return the level of each piece: a quantile of its magnitudes, or that of a neighbour if larger."""
    pieces = max(1, len(signal) // piece)
    levels = np.empty(pieces)
    for k in range(pieces):
        end = len(signal) if k == pieces - 1 else (k + 1) * piece
        count = (end - k * piece + every - 1) // every
        values = np.empty(count)
        for i in range(count):
            values[i] = abs(signal[k * piece + i * every])
        place = int(share * (count - 1))
        levels[k] = np.partition(values, place)[place]
    wide = levels.copy()
    for k in range(pieces):
        wide[k] = max(levels[k], levels[max(0, k - 1)], levels[min(pieces - 1, k + 1)])
    return wide


@_jit
def bridge_clicks(raw: Array, limits: ClickLimits) -> Array:
    """Return the samples, with short bursts far above their surroundings replaced by straight lines."""
    reach, piece, share, most, longest = limits
    count = len(raw)
    high = _above_baseline(raw, reach)
    levels = piece_levels(high, piece, share, EVERY)
    clean = raw.copy()
    i = 0
    while i < count:
        k = min(i // piece, len(levels) - 1)
        end = count if k == len(levels) - 1 else (k + 1) * piece
        i = _first_beyond(high, i, end, most * levels[k])
        if i == end:
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


@_jit
def _above_baseline(raw: Array, reach: int) -> Array:
    """Subtract from each sample the mean of the samples within `reach` on both sides."""
    count = len(raw)
    sums = np.empty(count + 1)
    sums[0] = 0.0
    for i in range(count):
        sums[i + 1] = sums[i] + raw[i]
    high = np.empty(count)
    for i in range(min(reach, count)):
        top = min(count, i + reach + 1)
        high[i] = raw[i] - sums[top] / top
    each = 1.0 / (2 * reach + 1)
    for i in range(reach, count - reach):
        high[i] = raw[i] - (sums[i + reach + 1] - sums[i - reach]) * each
    for i in range(max(reach, count - reach), count):
        high[i] = raw[i] - (sums[count] - sums[i - reach]) / (count - i + reach)
    return high


@_jit
def _first_beyond(values: Array, begin: int, end: int, most: float) -> int:
    """Return the first index in begin..end whose magnitude exceeds `most`; `end` if there is none."""
    while begin < end:
        part = min(begin + TOGETHER, end)
        beyond = 0
        for i in range(begin, part):
            beyond += abs(values[i]) > most
        if beyond:
            while abs(values[begin]) <= most:
                begin += 1
            return begin
        begin = part
    return end
