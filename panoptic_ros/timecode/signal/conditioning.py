"""Remove DC, hum and clicks from recorded samples, without moving the edges of the signal."""

from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.timecode.signal.clicks import EVERY, ClickLimits, bridge_clicks, piece_levels

Array = np.ndarray
_jit = njit(cache=True, error_model="numpy", nogil=True)
_sum = njit(cache=True, error_model="numpy", nogil=True, fastmath={"reassoc", "contract"})
FILTER_SECONDS = 0.014  # s, length of the high-pass filter
# Hz, minimum rate at which the low pass is computed; its values are interpolated linearly in between
KNOT_HZ = 6000.0
FINE_RATE = 32_000  # Hz, minimum rate after upsampling: edges lie between samples
BESIDE = 16  # samples on each side used to interpolate one upsampled value
WINDOW = "kaiser", 4.5  # window of the low pass and of the interpolation: type and shape parameter
LEVEL_SECONDS = 0.0125  # s, length of the piece over which one level is computed
# quantile of the magnitudes taken as level; high, as most samples of a drooping recording are low
LEVEL_SHARE = 0.8
CLIP = 1.8  # times the level; overshoot at edges stays below
BLANK = 3.0  # times the level; larger samples are clicks and are set to 0
CLICK = 2.4  # times the level; threshold for clicks before the high pass, which would smear them
CLICK_SECONDS = 0.0006  # s, maximum length of a click
BASELINE_SECONDS = 0.0015  # s on each side of a sample, to compute the baseline of the click test


class Conditioner:
    """Signal conditioner: click bridge, linear-phase high pass, upsampling at low rates, limiter.

    The filter is symmetric and its output is assigned to its centre, so edges stay in place. As a
    consequence, the newest `reach` samples wait for the next chunk.
    """

    def __init__(self, sample_rate: int, corner_hz: float):
        self.up = max(1, -(-FINE_RATE // sample_rate))
        self._step = max(1, int(sample_rate / KNOT_HZ))
        # samples of the low pass on each side
        knots = int(0.5 * FILTER_SECONDS * sample_rate / self._step) - 2
        # imported here: loading takes about a second, and most runs do not need it
        from scipy.signal import firwin

        low = firwin(2 * knots + 1, corner_hz, window=WINDOW, fs=sample_rate / self._step)
        self._low_pass = low / self._step  # divided by the integral of a hat
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
        self._raw = np.zeros(self._beside)  # silence is assumed before the first sample
        self._history = np.zeros(self._half)

    def push(self, raw: Array) -> Array:
        """Return the conditioned samples, `up` per recorded sample; the newest `reach` ones are delayed."""
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
    """Return weights (up - 1, 2 M) that interpolate samples at places between two samples (windowed sinc)."""
    away = np.arange(1 - BESIDE, BESIDE + 1) - np.arange(1, up)[:, None] / up
    rows = np.sinc(away) * np.i0(WINDOW[1] * np.sqrt(1.0 - (away / BESIDE) ** 2))
    shares: Array = rows / rows.sum(axis=1, keepdims=True)
    return shares


@_sum
def hat_sums(rows: Array, step: int) -> Array:
    """Return the inner products (I, K) of rows (I, N) with triangular hats.

    Hats are centred on every `step`-th sample and fall to 0 at the neighbouring centres.
    """
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
    """Subtract the symmetric low pass from the samples; return those in the middle of the stretch (N,).

    Args:
        hats: (K,) `hat_sums` of the samples.
        low_pass: (2 M + 1,) filter taps, one per `step` samples. (M + 2) * step samples are lost at each end.
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
    """Insert interpolated samples between the given samples; M samples are lost at each end.

    Args:
        weights: (U, 2 M) weights of the neighbouring samples, one row per inserted sample.
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
    """Clip samples of `signal` far above its local level; set samples still farther above it to 0.

    Args:
        piece: (samples) length of the piece over which one level is computed.
        share: (0..1) quantile of the magnitudes that is taken as the level.
        clip: Ratio to the level at which samples are clipped.
        blank: Ratio to the level above which samples are set to 0.
    """
    levels = piece_levels(signal, piece, share, EVERY)
    for k in range(len(levels)):
        end = len(signal) if k == len(levels) - 1 else (k + 1) * piece
        most, least = clip * levels[k], blank * levels[k]
        for i in range(k * piece, end):
            value = signal[i]
            kept = min(max(value, -most), most)
            signal[i] = kept if abs(value) <= least else 0.0
