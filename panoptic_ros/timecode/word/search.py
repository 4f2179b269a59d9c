"""The grids of cells on which a signal has most energy, and where its sync words are."""

from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.timecode.signal.half_cells import Grid, energy, grid_energy
from panoptic_ros.timecode.word.layout import WORD_CELLS

Array = np.ndarray
_jit = njit(cache=True, error_model="numpy", nogil=True)
SHIFTS = np.linspace(-0.3, 0.3, 13)  # cells, about the expected middle of a word
STRETCHES = np.linspace(-0.012, 0.012, 7)  # relative, of the length of a cell


def nearby_grid(sums: Array, grid: Grid) -> Grid:
    """The grid near the expected one of a word on which the signal has most energy."""
    return best_grid(sums, grid, -0.5 * WORD_CELLS, WORD_CELLS, SHIFTS, STRETCHES)


@_jit
def best_grid(sums: Array, grid: Grid, first: float, count: int, shifts: Array, stretches: Array) -> Grid:
    """The grid of most energy near another: middle shifted in cells, length stretched."""
    best, found = -1.0, grid
    for stretch in stretches:
        cell = grid.cell * (1.0 + stretch)
        for shift in shifts:
            tried = Grid(grid.middle + shift * grid.cell, cell)
            energy = grid_energy(sums, tried, first, count)
            if energy > best:
                best, found = energy, tried
    return found


@_jit
def scan_lengths(sums: Array, begin: float, span: float, halves: Array, phases: int) -> Array:
    """For each length of a half cell the largest mean square level over the phases, and that edge, (H, 2)."""
    rows = np.empty((len(halves), 2))
    for i, half in enumerate(halves):
        count = int(span / half) - 1
        rows[i, 0] = -1.0
        for phase in range(phases):
            start = begin + half * phase / phases
            total = energy(sums, start, half, count) / (half * half * count)
            if total > rows[i, 0]:
                rows[i, 0], rows[i, 1] = total, start
    return rows


@_jit
def sync_means(bits: Array, pattern: Array, word: int) -> Array:
    """Mean number of bits (word,) that agree with a pattern (M,) from each place of the words on."""
    totals, words = np.zeros(word), np.zeros(word)
    for i in range(len(bits) - len(pattern) + 1):
        agreeing = 0
        for j in range(len(pattern)):
            agreeing += bits[i + j] == pattern[j]
        totals[i % word] += agreeing
        words[i % word] += 1.0
    return totals / np.maximum(words, 1.0)
