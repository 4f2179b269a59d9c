"""Find the cell grids of maximum signal energy, and the positions of the sync words."""

from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.timecode.signal.half_cells import CellGrid, energy, grid_energy
from panoptic_ros.timecode.word.layout import WORD_CELLS

Array = np.ndarray
_jit = njit(cache=True, error_model="numpy", nogil=True)
SHIFTS = np.linspace(-0.3, 0.3, 13)  # cells, shifts about the expected middle of a word
STRETCHES = np.linspace(-0.012, 0.012, 7)  # relative changes of the cell length


def nearby_grid(sums: Array, grid: CellGrid) -> CellGrid:
    """Return the grid of maximum energy near the expected grid of a word."""
    return best_grid(sums, grid, -0.5 * WORD_CELLS, WORD_CELLS, SHIFTS, STRETCHES)


@_jit
def best_grid(
    sums: Array, grid: CellGrid, first: float, count: int, shifts: Array, stretches: Array
) -> CellGrid:
    """Return the grid of maximum energy near a given one.

    Args:
        first: first cell of the energy sum, counted from the middle.
        count: number of cells in the energy sum.
        shifts: (cells) shifts of the middle to try.
        stretches: (relative) changes of the cell length to try.
    """
    best, found = -1.0, grid
    for stretch in stretches:
        cell = grid.cell * (1.0 + stretch)
        for shift in shifts:
            tried = CellGrid(grid.middle + shift * grid.cell, cell)
            energy = grid_energy(sums, tried, first, count)
            if energy > best:
                best, found = energy, tried
    return found


@_jit
def scan_lengths(sums: Array, begin: float, span: float, halves: Array, phases: int) -> Array:
    """Return, for each half-cell length, the maximum mean square level over the phases and a position (H, 2).

    The position is that of the first half-cell edge at the phase of the maximum.
    """
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
    """Return the mean number of bits that match a pattern (M,), for each start position in a word (word,)."""
    totals, words = np.zeros(word), np.zeros(word)
    for i in range(len(bits) - len(pattern) + 1):
        agreeing = 0
        for j in range(len(pattern)):
            agreeing += bits[i + j] == pattern[j]
        totals[i % word] += agreeing
        words[i % word] += 1.0
    return totals / np.maximum(words, 1.0)
