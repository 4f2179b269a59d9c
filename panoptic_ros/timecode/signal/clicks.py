"""Short bursts far above the signal: found and bridged."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.kernels import njit

Array = np.ndarray
_jit = njit(cache=True, error_model="numpy", nogil=True)
EVERY = 7  # every 7th sample tells the level; no multiple of the length of a half cell
TOGETHER = 64  # samples that are tested in one go


class ClickLimits(NamedTuple):
    """What is a click.

    Args:
        reach: samples to both sides whose mean is the baseline.
        piece: samples over which the level is taken.
        share: of the samples that lie below the level.
        most: times the level; what is beyond is a click.
        longest: samples of a burst; what lasts longer is no click.
    """

    reach: int
    piece: int
    share: float
    most: float
    longest: int


@_jit
def piece_levels(signal: Array, piece: int, share: float, every: int) -> Array:
    """The quantile of the magnitude in each piece, or in a neighbour if that is more."""
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
    """The samples with short bursts far above their neighbourhood replaced by straight lines."""
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
    """Samples minus the mean of those up to `reach` to both sides."""
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
    """Index of the first of some values whose magnitude is more than another; the end if there is none."""
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
