"""When exactly a word began: least squares of its known edge train on the raw samples.

With the bits known, the signal is known up to start, cell length, level and its slow change, and a
baseline below `BASELINE_HZ` (DC, hum, droop), which is projected out. For white noise this is the
maximum-likelihood estimate, whose variance is that of Cramer and Rao for these edges.
"""
from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import erf

Array = np.ndarray
BASELINE_HZ = 250.0
EDGE_SECONDS = 15.6e-6  # standard deviation of an edge of 40 us rise time
EDGE_SAMPLES = 0.4  # at least, since samples are taken through a low pass
MARGIN = 0.45  # cells before the first and after the last edge
STEPS, FIRST_STEPS = 9, 3  # of Gauss and Newton; the first ones come from afar
OUTLIER = 4.0  # standard deviations
GROSS = 2.5  # times the level: more than a misplaced edge


@dataclass(frozen=True, slots=True)
class WordFit:
    """Times in samples: middle of the word, length of a cell, and their standard deviations."""

    middle: float
    cell: float
    middle_std: float
    cell_std: float


def fit_word(
    raw: Array, first_index: int, bits: Array, start: float, cell: float, sample_rate: int
) -> WordFit | None:
    """Fit a word; None if it is not wholly inside of the samples or the fit does not settle.

    Args:
        raw: (N,) samples, the first of which has index `first_index`.
        bits: (80,) in the order of the file.
        start, cell: a guess, good to a tenth of a cell over the word.
    """
    count = len(bits)
    low = int(np.ceil(start - MARGIN * cell))
    high = int(np.floor(start + (count + MARGIN) * cell)) + 1
    if low < first_index and start > first_index - cell:
        low = first_index  # the stream began with this word
    if low < first_index or high > first_index + len(raw):
        return None
    values = raw[low - first_index : high - first_index]
    at = np.arange(low, high, dtype=np.float64)
    places = _edge_places(bits)
    sigma = max(EDGE_SECONDS * sample_rate, EDGE_SAMPLES)
    baseline = _baseline(len(values), max(4, int(2.0 * BASELINE_HZ * len(values) / sample_rate)))
    half = 0.5 * count
    middle, clean = start + half * cell, values
    for step in range(STEPS):
        columns = _columns(at, middle, cell, places - half, sigma)
        free = columns - baseline @ (baseline.T @ columns)
        target = clean - baseline @ (baseline.T @ clean)
        solution = np.linalg.lstsq(free.T @ free, free.T @ target, rcond=None)[0]
        level = float(solution[0])
        if abs(level) < 1e-9:
            return None
        move, stretch = solution[2] / level, solution[3] / level
        middle += float(np.clip(move, -0.2 * cell, 0.2 * cell))
        cell += float(np.clip(stretch, -0.002 * cell, 0.002 * cell))
        error = target - free @ solution
        spread = 1.4826 * float(np.median(np.abs(error)))
        # What sticks out is a click: taken as the model says. Far from the solution, edges stick out too.
        most = OUTLIER * spread if step >= FIRST_STEPS else GROSS * abs(level)
        whole = values - clean + error
        clean = np.where(np.abs(whole) > most, values - whole, values)
        if step > FIRST_STEPS and abs(move) < 1e-4:
            break
    noise = float(np.sqrt(error @ error / max(1, len(error) - baseline.shape[1] - 4)))
    covariance = np.linalg.pinv(free.T @ free) * (noise / level) ** 2
    return WordFit(middle, cell, float(np.sqrt(covariance[2, 2])), float(np.sqrt(covariance[3, 3])))


def _edge_places(bits: Array) -> Array:
    """Edges in cells from the word's start, the one that ends it included."""
    starts = np.arange(len(bits) + 1, dtype=np.float64)
    return np.sort(np.concatenate([starts, np.flatnonzero(bits) + 0.5]))


def _columns(at: Array, middle: float, cell: float, places: Array, sigma: float) -> Array:
    """Regressors (N, 4): the wave, the wave times time, and its derivatives by middle and cell."""
    edges = middle + cell * places
    nearest = np.clip(np.searchsorted(0.5 * (edges[1:] + edges[:-1]), at), 0, len(edges) - 1)
    sign = np.where(nearest % 2 == 0, 1.0, -1.0)
    distance = (at - edges[nearest]) / sigma
    wave = sign * erf(distance / np.sqrt(2.0))
    slope = -sign * np.sqrt(2.0 / np.pi) / sigma * np.exp(-0.5 * distance**2)
    ramp = np.linspace(-1.0, 1.0, len(at))
    return np.stack([wave, wave * ramp, slope, slope * places[nearest]], axis=1)


@lru_cache(maxsize=16)
def _baseline(count: int, terms: int) -> Array:
    """Orthonormal slow functions (count, terms)."""
    angle = np.pi * (np.arange(count)[:, None] + 0.5) * np.arange(terms) / count
    basis = np.cos(angle) * np.sqrt(2.0 / count)
    basis[:, 0] = np.sqrt(1.0 / count)
    basis.flags.writeable = False
    return basis
