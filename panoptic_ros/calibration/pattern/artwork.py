"""Random pattern to print or project: black and white cells of three sizes."""

from __future__ import annotations

import numpy as np

Array = np.ndarray
CELL_M = 0.002  # m, smallest cell: 2 px of an HD camera 2 m away
SIZES = (1, 4, 16)  # cells, of the three sizes: cameras near and far find features
SEED = 47  # one pattern, so that prints can be repeated


def random_pattern(width: float, height: float) -> Array:
    """Return the cells (H, W) bool, True = black, of a pattern of a width and height, m."""
    rng = np.random.default_rng(SEED)
    rows, columns = (max(1, int(side / CELL_M)) for side in (height, width))
    total = np.zeros((rows, columns))
    for size in SIZES:
        coarse = rng.standard_normal((-(-rows // size), -(-columns // size)))
        total += np.kron(coarse, np.ones((size, size)))[:rows, :columns]
    black: Array = total > np.median(total)
    return black
