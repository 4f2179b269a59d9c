"""Onsets in bands of energy, and how those of two microphones agree at every lag."""

from __future__ import annotations

import numpy as np

Array = np.ndarray
QUIET = 0.1  # share of the time that is quieter than the noise floor
LEAST = 1e-12  # energy, far below one level of 16 bits


def onsets(energies: Array, rate: float, rise_s: float, squared: bool, level: float = QUIET) -> Array:
    """How energy rises (T, B), in units of the standard deviation of each band, of mean 0; 0 in dead bands.

    Args:
        energies: (T, B). rate: frames a second. rise_s: over which rises are taken.
        squared: whether sudden ones count more.
        level: quantile of the energy that is the floor, below which nothing counts.
    """
    if not len(energies):
        return np.empty_like(energies)
    from scipy.ndimage import uniform_filter1d  # takes long to load, which most runs do not need

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
