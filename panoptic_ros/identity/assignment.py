"""Who is who at an instant: the best pairs of all that may be."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

Array = np.ndarray
FORBIDDEN = 1e6  # cost of pairs outside of the gates


def best_pairs(cost: Array) -> list[tuple[int, int]]:
    """Pairs (row, column) of the optimal assignment (Hungarian) of a cost (N, M); infinite ones cannot be."""
    if not cost.size:
        return []
    rows, columns = linear_sum_assignment(np.where(np.isfinite(cost), cost, FORBIDDEN))
    return [(int(i), int(k)) for i, k in zip(rows, columns) if np.isfinite(cost[i, k])]
