"""A grid of cells: the bit clock of a word."""
from __future__ import annotations

from typing import NamedTuple

from panoptic_ros.kernels import njit

_jit = njit(cache=True, error_model="numpy", nogil=True)


class Grid(NamedTuple):
    """Cell u from the middle of a word begins at middle + cell * (u + bend * u^2), in samples.

    Args:
        middle: of the word, samples.
        cell: its length at the middle, samples.
        bend: half of the relative change of the cell's length from cell to cell.
    """

    middle: float
    cell: float
    bend: float


@_jit
def place_of(grid: Grid, u: float) -> float:
    """Where cell u begins, samples."""
    return grid.middle + grid.cell * (u + grid.bend * u * u)


@_jit
def moved_grid(grid: Grid, cells: float) -> Grid:
    """The same grid about another middle."""
    turn = 1.0 + 2.0 * grid.bend * cells
    return Grid(place_of(grid, cells), grid.cell * turn, grid.bend / turn)
