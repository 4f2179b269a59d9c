"""From recorded samples to a signal without DC, hum and clicks, with edges where they were."""

from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.timecode.signal.clicks import EVERY, ClickLimits, bridge_clicks, piece_levels

Array = np.ndarray
_jit = njit(cache=True, error_model="numpy", nogil=True)
_sum = njit(cache=True, error_model="numpy", nogil=True, fastmath={"reassoc", "contract"})
FILTER_SECONDS = 0.014
KNOT_HZ = 6000.0  # least rate at which the low pass is computed, with lines between
FINE_RATE = 32_000  # Hz, at least: edges lie between samples
BESIDE = 16  # samples to both sides that an upsampled one is computed from
WINDOW = "kaiser", 4.5
LEVEL_SECONDS = 0.0125
LEVEL_SHARE = 0.8  # of the samples lie below the level; where recordings droop, most are far below
CLIP = 1.8  # times the level; edges overshoot by less
BLANK = 3.0  # times the level; what is beyond is a click and is set to 0
CLICK = 2.4  # times the level, before the filter could smear it
CLICK_SECONDS = 0.0006  # at most
BASELINE_SECONDS = 0.0015  # to both sides of a sample that may be a click


class Conditioner:
    """Bridges clicks, then a linear-phase high pass and a limiter; low sample rates are upsampled by `up`.

    The filter is symmetric and its output belongs to its centre, so edges stay where they are. In exchange
    the newest `reach` samples wait for the next chunk.
    """

    def __init__(self, sample_rate: int, corner_hz: float):
        self.up = max(1, -(-FINE_RATE // sample_rate))
        self._step = max(1, int(sample_rate / KNOT_HZ))
        knots = int(0.5 * FILTER_SECONDS * sample_rate / self._step) - 2  # of the low pass, to each side
        from scipy.signal import firwin  # takes a second to load, which most runs do not need

        low = firwin(2 * knots + 1, corner_hz, window=WINDOW, fs=sample_rate / self._step)
        self._low_pass = low / self._step  # hats are so large
        self._between = _between(self.up)
        self._half = (knots + 2) * self._step + (BESIDE if self.up > 1 else 0)
        self._beside = int((BASELINE_SECONDS + CLICK_SECONDS) * sample_rate) + 2
        self.reach = self._half + self._beside
        self._piece = max(8, int(LEVEL_SECONDS * sample_rate * self.up))
        self._clicks = ClickLimits(
            reach=int(BASELINE_SECONDS * sample_rate),
            piece=max(8, int(LEVEL_SECONDS * sample_rate)),
            share=LEVEL_SHARE,
            most=CLICK,
            longest=max(2, int(CLICK_SECONDS * sample_rate)),
        )
        self._raw = np.zeros(self._beside)  # before the first sample there was silence
        self._history = np.zeros(self._half)

    def push(self, raw: Array) -> Array:
        """Conditioned samples, `up` for each recorded one, of which the newest `reach` still wait."""
        raw = np.concatenate([self._raw, raw])
        if len(raw) <= 2 * self._beside:
            self._raw = raw
            return np.zeros(0)
        clean = bridge_clicks(raw, self._clicks)[self._beside : -self._beside]
        self._raw = raw[-2 * self._beside :]
        joined = np.concatenate([self._history, clean])
        if len(joined) <= 2 * self._half:
            self._history = joined
            return np.zeros(0)
        self._history = joined[-2 * self._half :]
        signal = high_pass(joined, hat_sums(joined[None], self._step)[0], self._low_pass, self._step)
        if self.up > 1:
            signal = between(signal, self._between)
        limit(signal, self._piece, LEVEL_SHARE, CLIP, BLANK)
        return signal


def _between(up: int) -> Array:
    """Interpolation weights (up - 1, 2 M) of samples for the places between two samples (windowed sinc)."""
    away = np.arange(1 - BESIDE, BESIDE + 1) - np.arange(1, up)[:, None] / up
    rows = np.sinc(away) * np.i0(WINDOW[1] * np.sqrt(1.0 - (away / BESIDE) ** 2))
    shares: Array = rows / rows.sum(axis=1, keepdims=True)
    return shares


@_sum
def hat_sums(rows: Array, step: int) -> Array:
    """Products (I, K) of rows (I, N) with triangular hats on every `step`-th sample, 0 at the next ones."""
    count = rows.shape[1]
    sums = np.zeros((len(rows), (count - 1) // step + 2))
    for i in range(len(rows)):
        row, out = rows[i], sums[i]
        for j in range(step):
            after = j / step
            for k in range((count - 1 - j) // step + 1):
                value = row[k * step + j]
                out[k] += (1.0 - after) * value
                out[k + 1] += after * value
    return sums


@_jit
def high_pass(samples: Array, hats: Array, low_pass: Array, step: int) -> Array:
    """Samples minus their symmetric low pass, for those in the middle of a stretch (N,).

    Args:
        hats: (K,) the samples' `hat_sums`.
        low_pass: (2 M + 1,) for every `step`-th sample; M + 2 times that are lost at both ends.
    """
    side = len(low_pass) // 2
    low = np.zeros(len(hats) - 2 * side)
    for j in range(len(low_pass)):
        for k in range(len(low)):
            low[k] += low_pass[j] * hats[j + k]
    lost = (side + 2) * step
    high = samples[lost : len(samples) - lost].copy()
    for j in range(step):
        after = j / step
        for k in range((len(high) - 1 - j) // step + 1):
            high[k * step + j] -= (1.0 - after) * low[k + 2] + after * low[k + 3]
    return high


@_jit
def between(samples: Array, weights: Array) -> Array:
    """Samples with interpolated ones between them; M are lost at both ends.

    Args:
        weights: (U, 2 M) of the samples beside each place.
    """
    places, beside = len(weights) + 1, weights.shape[1] // 2
    count = len(samples) - 2 * beside
    fine = np.empty((count, places))
    for i in range(count):
        fine[i, 0] = samples[beside + i]
    values = np.empty(count)
    for p in range(places - 1):
        for i in range(count):
            values[i] = 0.0
        for j in range(2 * beside):
            for i in range(count):
                values[i] += weights[p, j] * samples[i + j + 1]
        for i in range(count):
            fine[i, p + 1] = values[i]
    return fine.reshape(count * places)


@_jit
def limit(signal: Array, piece: int, share: float, clip: float, blank: float) -> None:
    """Clip what is far above the level of its neighbourhood, in place; set to 0 what is still farther."""
    levels = piece_levels(signal, piece, share, EVERY)
    for k in range(len(levels)):
        end = len(signal) if k == len(levels) - 1 else (k + 1) * piece
        most, least = clip * levels[k], blank * levels[k]
        for i in range(k * piece, end):
            value = signal[i]
            kept = min(max(value, -most), most)
            signal[i] = kept if abs(value) <= least else 0.0
