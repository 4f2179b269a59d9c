"""A grid of cells: the bit clock of a word."""

from __future__ import annotations

from typing import NamedTuple

from panoptic_ros.kernels import njit

_jit = njit(cache=True, error_model="numpy", nogil=True)


class Grid(NamedTuple):
    """Cell u from the middle of a word begins at middle + cell * u, in samples.

    Args:
        middle: of the word, samples.
        cell: its length, samples.
    """

    middle: float
    cell: float


@_jit
def place_of(grid: Grid, u: float) -> float:
    """Where cell u begins, samples."""
    return grid.middle + grid.cell * u


@_jit
def moved_grid(grid: Grid, cells: float) -> Grid:
    """The same grid about another middle."""
    return Grid(place_of(grid, cells), grid.cell)
