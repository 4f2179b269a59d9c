"""The loop of learning the shape of a step, compiled."""
from __future__ import annotations

from functools import lru_cache

import numpy as np
from numba import njit

Array = np.ndarray
_jit = njit(cache=True, error_model="numpy", nogil=True)


@_jit
def shape_rows(rows: Array, low: int, grid: Array, places: Array, splines: Array, knot: float) -> None:
    """Write how each cubic spline of the shape of a step shows in a word to rows (J, N).

    Args:
        splines: (J, P + 1, 2 R) their tables, see `fit_kernels`.
        knot: samples by which each begins after the one before.
    """
    phases, reach = splines.shape[1] - 1, splines.shape[2] // 2
    rows[:] = 0.0
    middle, cell, bend = grid
    sign = 1.0
    for k in range(len(places)):
        u = places[k]
        edge = middle + cell * (u + bend * u * u) - low
        after = int(np.ceil(edge))
        place = (after - edge) * phases
        below = min(int(place), phases - 1)
        part = place - below
        first = after - reach
        for j in range(max(0, -first), min(2 * reach, rows.shape[1] - first)):
            last = min(int((j + place / phases) / knot), len(splines) - 1)
            for s in range(max(0, last - 3), last + 1):
                value = splines[s, below, j] * (1.0 - part) + splines[s, below + 1, j] * part
                rows[s, first + j] += sign * value
        sign = -sign


@lru_cache(maxsize=1)
def compile_shape() -> None:
    """Compile this for the types that it is called with, or take it from numba's cache."""
    splines = np.ones((2, 3, 4))
    splines.flags.writeable = False  # as the real ones: another type for numba
    shape_rows(np.empty((2, 40)), 0, np.array([20.0, 4.0, 0.0]), np.arange(-4.0, 5.0), splines, 1.0)
