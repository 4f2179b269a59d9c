"""A grid of cells: a word's bit clock.

A grid is (middle, cell, bend): cell u from the middle begins at middle + cell * (u + bend * u^2).
"""
from __future__ import annotations

import numpy as np
from numba import njit

Array = np.ndarray
_jit = njit(cache=True, error_model="numpy", nogil=True)


@_jit
def moved_grid(grid: Array, cells: float) -> Array:
    """The same grid about another middle."""
    middle, cell, bend = grid
    turn = 1.0 + 2.0 * bend * cells
    return np.array([middle + cell * (cells + bend * cells * cells), cell * turn, bend / turn])
