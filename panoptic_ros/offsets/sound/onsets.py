"""Detect onsets in bands of energy."""

from __future__ import annotations

import numpy as np

Array = np.ndarray
QUIET = 0.1  # share of the time that is quieter than the noise floor
LEAST = 1e-12  # energy, far below one level of 16-bit samples


def onsets(energies: Array, rate: float, rise_s: float, squared: bool, level: float = QUIET) -> Array:
    """Return energy rises (T, B) of mean 0, in standard deviations of each band; 0 in bands without signal.

    Args:
        energies: (T, B) energy per frame and band.
        rate: frames per second.
        rise_s: (s) time over which a rise is measured.
        squared: True to emphasise sudden rises.
        level: quantile of the energy that is the floor; energy below it hardly counts.
    """
    if not len(energies):
        return np.empty_like(energies)
    from scipy.ndimage import uniform_filter1d  # imported here: it loads slowly, and most runs do not need it

    floor = np.maximum(np.quantile(energies, level, axis=0), LEAST)
    loudness = np.log1p(energies / floor)
    steps = max(1, round(rise_s * rate))
    rises = np.zeros_like(loudness)
    rises[steps:] = np.maximum(loudness[steps:] - loudness[:-steps], 0.0)
    if squared:
        rises *= rises
    rises -= uniform_filter1d(rises, max(3, round(rate)), axis=0, mode="nearest")
    spread = rises.std(axis=0)
    return np.where(spread > 1e-6, rises / np.maximum(spread, 1e-6), 0.0).astype(np.float32)
