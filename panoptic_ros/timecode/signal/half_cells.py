"""Integrate the signal over half cells of a word's cell grid, from the running sum of the signal.

With biphase-mark coding the level changes only at half-cell boundaries. Integrals over half cells are
therefore the output of a matched filter. Their energy is maximal if the edges of the grid coincide with those
of the signal.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.kernels import njit

Array = np.ndarray
_jit = njit(cache=True, error_model="numpy", nogil=True)


class CellGrid(NamedTuple):
    """Grid of a word's cells: cell u, counted from the middle of the word, begins at middle + cell * u.

    Args:
        middle: middle of the word, samples.
        cell: length of a cell, samples.
    """

    middle: float
    cell: float


@_jit
def place_of(grid: CellGrid, u: float) -> float:
    """Return the sample at which cell u begins."""
    return grid.middle + grid.cell * u


@_jit
def moved_grid(grid: CellGrid, cells: float) -> CellGrid:
    """Return the same grid with its middle moved by `cells` cells."""
    return CellGrid(place_of(grid, cells), grid.cell)


@_jit
def integral(sums: Array, position: float) -> float:
    """Return the integral of the signal up to a fractional position; sample i covers i - 0.5 to i + 0.5."""
    place = min(max(position + 0.5, 0.0), len(sums) - 1.001)
    below = int(place)
    part = place - below
    value: float = sums[below] * (1.0 - part) + sums[below + 1] * part
    return value


@_jit
def half_levels(sums: Array, grid: CellGrid, first: float, count: int) -> Array:
    """Return the mean levels (2 * count,) of the half cells of `count` cells, from cell `first` of a grid."""
    levels = np.empty(2 * count)
    before, value = 0.0, 0.0
    for k in range(2 * count + 1):
        place = place_of(grid, first + 0.5 * k)
        now = integral(sums, place)
        if k > 0:
            levels[k - 1] = (now - value) / (place - before)
        before, value = place, now
    return levels


@_jit
def tick_levels(sums: Array, ticks: Array) -> Array:
    """Return the mean levels (N,) of the half cells between ticks (N + 1,)."""
    levels = np.empty(len(ticks) - 1)
    before = integral(sums, ticks[0])
    for k in range(len(levels)):
        now = integral(sums, ticks[k + 1])
        levels[k] = (now - before) / (ticks[k + 1] - ticks[k])
        before = now
    return levels


@_jit
def energy(sums: Array, start: float, half: float, count: int) -> float:
    """Return the sum of squared integrals over `count` half cells of length `half`, from position `start`.

    Half cells outside the running sum contribute 0.
    """
    total, last = 0.0, len(sums) - 1.001
    place, k = start + 0.5, 0
    while place < 0.0 and k < count:
        place += half
        k += 1
    if not 0.0 <= place <= last:
        return 0.0
    below = int(place)
    value = sums[below] + (sums[below + 1] - sums[below]) * (place - below)
    while k < count:
        place += half
        if place > last:
            break
        below = int(place)
        now = sums[below] + (sums[below + 1] - sums[below]) * (place - below)
        total += (now - value) * (now - value)
        value = now
        k += 1
    return total


@_jit
def grid_energy(sums: Array, grid: CellGrid, first: float, count: int) -> float:
    """Return the mean square of `half_levels`."""
    cell = grid.cell
    total = energy(sums, place_of(grid, first), 0.5 * cell, 2 * count)
    return total * 4.0 / (cell * cell * 2.0 * count)
