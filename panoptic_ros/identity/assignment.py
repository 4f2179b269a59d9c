"""Optimal one-to-one assignment of rows to columns, with a gate."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

Array = np.ndarray


def best_pairs(cost: Array, gate: float) -> list[tuple[int, int]]:
    """Return the pairs (row, column) of a cost (N, M) that minimise the sum of `cost - gate` over the pairs.

    A row or a column without a partner costs the gate, so one good pair beats two poor ones. A pair whose
    cost reaches the gate or is not finite is never chosen. The pairs are in the order of the rows.

    Args:
        gate: the cost of a row that has no partner, in the unit of the cost.
    """
    if not cost.size:
        return []
    worth = np.where(cost < gate, cost - gate, 0.0)  # 0 = row and column stay without a partner
    rows, columns = linear_sum_assignment(worth)
    return [(int(i), int(k)) for i, k in zip(rows, columns) if worth[i, k] < 0.0]
