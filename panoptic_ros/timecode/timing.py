"""When exactly a word began: least squares of its known edge train on the raw samples.

With the bits known, the signal is known up to start, cell length, level and its slow change, and a
baseline below `BASELINE_HZ` (DC, hum, droop), which is projected out. For white noise this is the
maximum-likelihood estimate, whose variance is that of Cramer and Rao for these edges. The variance is
not taken from the noise, but from what the edges say one by one: so jitter, echoes and clipping show.
"""
from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import erf

from panoptic_ros.timecode.fit_kernels import fit_step, left_over, score_scatter, wave_columns

Array = np.ndarray
BASELINE_HZ = 250.0
EDGE_SECONDS = 15.6e-6  # standard deviation of an edge of 40 us rise time
EDGE_SAMPLES = 0.4  # at least, since samples are taken through a low pass
MARGIN = 0.45  # cells before the first and after the last edge
STEPS = 8  # of Gauss and Newton
SETTLED = 0.04  # standard deviations of an edge: the next step would be the square of that
LOST = 0.05  # cells
OUTLIER = 4.0  # standard deviations
SHAKEN_SECONDS = 40e-6  # by which single edges may be misplaced
GROSS = 0.25  # times the level: more than a slightly misplaced edge
ERROR_FUNCTION = erf(np.arange(602) / 100.0 / np.sqrt(2.0))


@dataclass(frozen=True, slots=True)
class WordFit:
    """The grid of a word's cells: its middle and the length of a cell there in samples, its bend.

    Args:
        covariance: (3, 3) of middle, cell and bend.
    """

    middle: float
    cell: float
    bend: float
    covariance: Array

    @property
    def grid(self) -> Array:
        """(3,) middle, cell, bend."""
        return np.array([self.middle, self.cell, self.bend])

    @property
    def middle_std(self) -> float:
        """Samples."""
        return float(np.sqrt(self.covariance[0, 0]))

    @property
    def cell_std(self) -> float:
        """Samples."""
        return float(np.sqrt(self.covariance[1, 1]))


def fit_word(
    raw: Array, first_index: int, bits: Array, grid: Array, sample_rate: int, bending: bool = False
) -> WordFit | None:
    """Fit a word; None if it is not wholly inside of the samples or the fit does not settle.

    Args:
        raw: (N,) samples, the first of which has index `first_index`.
        bits: (80,) in the order of the file.
        grid: (3,) a guess, good to a tenth of a cell over the word.
        bending: whether the speed may change within the word.
    """
    half = 0.5 * len(bits)
    grid = grid.copy()
    ends = grid[0] + grid[1] * (np.array([-half, half]) + grid[2] * half**2)
    low = int(np.ceil(ends[0] - MARGIN * grid[1]))
    high = int(np.floor(ends[1] + MARGIN * grid[1])) + 1
    if low < first_index and ends[0] > first_index - grid[1]:
        low = first_index  # the stream began with this word
    if low < first_index or high > first_index + len(raw):
        return None
    values = raw[low - first_index : high - first_index]
    places = _edge_places(bits) - half
    sigma = max(EDGE_SECONDS * sample_rate, EDGE_SAMPLES)
    baseline = _baseline(len(values), max(4, int(2.0 * BASELINE_HZ * len(values) / sample_rate)))
    terms = 5 if bending else 4
    clean, cleaned, moved = values, False, np.inf
    for _ in range(STEPS):
        columns = wave_columns(low, clean, grid, places, sigma, ERROR_FUNCTION, terms)
        solution, inverse, square, weights = fit_step(columns, baseline)
        level = float(solution[0])
        if abs(level) < 1e-9 or not np.isfinite(solution).all():
            return None
        change = np.zeros(3)
        change[: terms - 2] = solution[2:] / level
        most = np.array([0.2 * grid[1], 0.002 * grid[1], 2e-4])
        grid += np.clip(change, -most, most)
        noise = np.sqrt(square / max(1, len(values) - len(baseline) - terms))
        moved = max(abs(change[0]), half * abs(change[1]))
        if moved > SETTLED * sigma + 0.1 * noise / abs(level) * np.sqrt(inverse[2, 2]):
            continue
        error = left_over(columns, solution, baseline, weights)
        if cleaned:
            break
        spread = 1.4826 * float(np.median(np.abs(error[::4])))
        shaken = SHAKEN_SECONDS * sample_rate * np.abs(columns[:, 2])  # of a level, where edges are misplaced
        outside = np.abs(error) > max(OUTLIER * spread, GROSS * abs(level)) + abs(level) * shaken
        if not outside.any():
            break
        clean, cleaned = np.where(outside, values - error, values), True
    else:
        error = left_over(columns, solution, baseline, weights)
    if moved > LOST * grid[1]:
        return None
    scatter = inverse[2:, 2:] @ score_scatter(columns, error, terms) @ inverse[2:, 2:] / level**2
    covariance = np.zeros((3, 3))
    covariance[: terms - 2, : terms - 2] = scatter
    return WordFit(float(grid[0]), float(grid[1]), float(grid[2]), covariance)


def _edge_places(bits: Array) -> Array:
    """Edges in cells from the word's start, the one that ends it included."""
    return np.flatnonzero(np.append(np.column_stack([np.ones_like(bits), bits]).ravel(), 1)) * 0.5


@lru_cache(maxsize=64)
def _baseline(count: int, terms: int) -> Array:
    """Orthonormal slow functions (terms, count)."""
    angle = np.pi * (np.arange(count) + 0.5) * np.arange(terms)[:, None] / count
    basis = np.cos(angle) * np.sqrt(2.0 / count)
    basis[0] = np.sqrt(1.0 / count)
    basis.flags.writeable = False
    return basis
