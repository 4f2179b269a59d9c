"""From raw samples to a signal without DC, hum and clicks, chunk by chunk, with no delay."""
from __future__ import annotations

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.signal import firwin

from panoptic_ros.timecode.click_kernels import bridge_clicks, limit

Array = np.ndarray
FILTER_SECONDS = 0.014
FINE_RATE = 32_000  # Hz, at least: edges lie between samples
LEVEL_SECONDS = 0.0125
LEVEL_SHARE = 0.8  # of the samples lie below the level; drooping recordings are mostly far below
CLIP = 1.8  # times the level; edges overshoot by less
BLANK = 3.0  # times the level; what is beyond is a click and says nothing
CLICK = 2.4  # times the level, before the filter could smear it
CLICK_SECONDS = 0.0006  # at most
BASELINE_SECONDS = 0.0015  # to both sides of a sample that may be a click


class Conditioner:
    """Clicks bridged, a linear-phase high pass, a limiter; low sample rates come out `up` times as fine.

    The filter is symmetric and its output is put where its centre was, so edges stay where they
    are; in exchange the newest `reach` samples wait for the next chunk.
    """

    def __init__(self, sample_rate: int, corner_hz: float):
        self.up = max(1, -(-FINE_RATE // sample_rate))
        self._half = int(0.5 * FILTER_SECONDS * sample_rate)
        self._beside = int((BASELINE_SECONDS + CLICK_SECONDS) * sample_rate) + 2
        self.reach = self._half + self._beside
        rate = sample_rate * self.up
        taps = 2 * self._half * self.up + 1
        high = firwin(taps, corner_hz, pass_zero=False, window=("kaiser", 4.5), fs=rate)
        if self.up > 1:  # the images of the signal above its band go too
            low = firwin(taps, 0.48 * sample_rate, window=("kaiser", 4.5), fs=rate)
            high = high + low
            high[taps // 2] -= 1.0  # both filters of symmetric kernels: band = high + low - all
        self._kernel = high * self.up
        self._spectra: dict[int, Array] = {}
        self._piece = max(8, int(LEVEL_SECONDS * rate))
        self._clicks = (
            int(BASELINE_SECONDS * sample_rate), max(8, int(LEVEL_SECONDS * sample_rate)),
            LEVEL_SHARE, CLICK, max(2, int(CLICK_SECONDS * sample_rate)),
        )  # fmt: skip
        self._raw = np.zeros(self._beside)  # before the first sample there was silence
        self._history = np.zeros(self._half)

    def push(self, raw: Array) -> Array:
        """Conditioned samples, `reach` behind the raw ones; `up` for each that came in after the start."""
        raw = np.concatenate([self._raw, raw])
        if len(raw) <= 2 * self._beside:
            self._raw = raw
            return np.zeros(0)
        clean = bridge_clicks(raw, *self._clicks)[self._beside : -self._beside]
        self._raw = raw[-2 * self._beside :]
        joined = np.concatenate([self._history, clean])
        if len(joined) <= 2 * self._half:
            self._history = joined
            return np.zeros(0)
        self._history = joined[-2 * self._half :]
        signal = self._filtered(joined)
        limit(signal, self._piece, LEVEL_SHARE, CLIP, BLANK)
        return signal

    def _filtered(self, joined: Array) -> Array:
        """The part of the convolution that needs no samples from outside."""
        fine = joined
        if self.up > 1:
            fine = np.zeros(len(joined) * self.up)
            fine[:: self.up] = joined
        length = next_fast_len(len(fine), real=True)
        if length not in self._spectra:
            self._spectra = {length: rfft(self._kernel, length)}  # all chunks but the last are alike
        out = irfft(rfft(fine, length) * self._spectra[length], length)
        return out[len(self._kernel) - 1 : len(fine)]
