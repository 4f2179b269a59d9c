"""From samples to bits in plain numpy: what the compiled kernels are checked against."""
from __future__ import annotations

import numpy as np

Array = np.ndarray


def integrate(sums: Array, positions: Array) -> Array:
    """Integral from the first sample to fractional positions (...), between samples by interpolation.

    Args:
        sums: (N + 1,) sums of samples, 0 first; sample i covers i - 0.5 to i + 0.5.
        positions: in samples.
    """
    place = np.clip(positions + 0.5, 0.0, len(sums) - 1.001)
    below = place.astype(np.int64)
    part = place - below
    return sums[below] * (1.0 - part) + sums[below + 1] * part


def half_cells(sums: Array, start: float, cell: float, count: int) -> Array:
    """Mean level (2 * count,) of the half cells of `count` cells from `start` on."""
    bounds = start + 0.5 * cell * np.arange(2 * count + 1)
    return np.diff(integrate(sums, bounds)) / (0.5 * cell)


def even_parity(halves: Array) -> bool:
    """Whether cells begin at even half cells: their levels always change sign between cells."""
    product = halves[:-1] * halves[1:]
    return float(product[1::2].sum()) <= float(product[0::2].sum())
