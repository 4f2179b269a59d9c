"""From raw samples to a signal without DC, hum and clicks, chunk by chunk, with no delay."""
from __future__ import annotations

import numpy as np
from scipy.signal import firwin, oaconvolve

Array = np.ndarray
FILTER_SECONDS = 0.014
FINE_RATE = 32_000  # Hz, at least: edges lie between samples
LEVEL_SECONDS = 0.0125
LEVEL_SHARE = 0.8  # of the samples lie below the level; drooping recordings are mostly far below
CLIP = 1.8  # times the level; edges overshoot by less
BLANK = 3.0  # times the level; what is beyond is a click and says nothing


class Conditioner:
    """A linear-phase high pass and a limiter; low sample rates come out `up` times as fine.

    The filter is symmetric and its output is put where its centre was, so edges stay where they
    are; in exchange the newest `reach` samples wait for the next chunk.
    """

    def __init__(self, sample_rate: int, corner_hz: float):
        self.up = max(1, -(-FINE_RATE // sample_rate))
        self.reach = int(0.5 * FILTER_SECONDS * sample_rate)
        rate = sample_rate * self.up
        taps = 2 * self.reach * self.up + 1
        high = firwin(taps, corner_hz, pass_zero=False, window=("kaiser", 4.5), fs=rate)
        if self.up > 1:  # the images of the signal above its band go too
            low = firwin(taps, 0.48 * sample_rate, window=("kaiser", 4.5), fs=rate)
            high = high + low
            high[taps // 2] -= 1.0  # both filters of symmetric kernels: band = high + low - all
        self._kernel = high * self.up
        self._piece = max(8, int(LEVEL_SECONDS * rate))
        self._history = np.zeros(self.reach)  # before the first sample there was silence

    def push(self, raw: Array) -> Array:
        """Conditioned samples, `reach` behind the raw ones; `up` for each that came in after the start."""
        joined = np.concatenate([self._history, raw])
        if len(joined) <= 2 * self.reach:
            self._history = joined
            return np.zeros(0)
        self._history = joined[-2 * self.reach :]
        fine = np.zeros(len(joined) * self.up)
        fine[:: self.up] = joined
        return self._limited(oaconvolve(fine, self._kernel, mode="valid"))

    def _limited(self, signal: Array) -> Array:
        """Clicks cut off at a little above the level of their neighbourhood."""
        pieces = np.array_split(signal, max(1, len(signal) // self._piece))
        levels = np.array([np.quantile(np.abs(piece), LEVEL_SHARE) for piece in pieces])
        beside = np.concatenate([levels[:1], levels, levels[-1:]])
        levels = np.maximum(levels, np.maximum(beside[:-2], beside[2:]))  # where a signal begins or ends
        return np.concatenate([_limit(piece, level) for piece, level in zip(pieces, levels)])


def _limit(piece: Array, level: float) -> Array:
    return np.where(np.abs(piece) > BLANK * level, 0.0, np.clip(piece, -CLIP * level, CLIP * level))
