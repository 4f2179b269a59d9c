"""The loops of the conditioning: high pass, upsampling and limiter."""

from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.timecode.signal.clicks import EVERY, piece_levels

Array = np.ndarray
_jit = njit(cache=True, error_model="numpy", nogil=True)


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
