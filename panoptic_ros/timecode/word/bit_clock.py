"""Moving a grid of cells to where the edges of the signal are."""

from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.timecode.signal.grid import Grid, place_of
from panoptic_ros.timecode.signal.half_cells import grid_energy, integral
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
def drawn_grid(sums: Array, grid: Grid, signs: Array, level: float) -> Grid:
    """The grid moved to the edges of a word whose signs (2 N,) are known.

    The integral over a quarter of a cell to both sides of an edge is zero if the edge is in the middle.

    Args:
        level: of the signal.
    """
    middle, cell = grid
    first = -0.25 * len(signs)
    reach = 0.25 * cell
    normal, right = 1e-9 * np.eye(2), np.zeros(2)
    for k in range(1, len(signs)):
        if signs[k] == signs[k - 1]:
            continue
        u = first + 0.5 * k
        place = place_of(grid, u)
        sum_here = integral(sums, place + reach) - integral(sums, place - reach)
        error = min(max(-signs[k] * sum_here / (2.0 * level), -reach), reach) / cell
        powers = np.array([1.0, u])
        for i in range(2):
            right[i] += powers[i] * error
            for j in range(2):
                normal[i, j] += powers[i] * powers[j]
    change = np.linalg.solve(normal, right)
    return Grid(middle + change[0] * cell, cell * (1.0 + change[1]))
