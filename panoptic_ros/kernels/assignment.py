"""Optimal assignment, compiled: scipy, whose own it is to the last tie, takes half a second to load."""

from __future__ import annotations

import numpy as np

from panoptic_ros.kernels.jit import njit

Array = np.ndarray
_jit = njit(cache=True, error_model="numpy", nogil=True)


def best_assignment(cost: Array) -> tuple[Array, Array]:
    """Rows in order and the column of each (min(N, M),), so that the sum of a finite cost (N, M) is least.

    Shortest augmenting paths with dual variables (Crouse 2016, On implementing 2D rectangular assignment
    algorithms); where sums are equal the identity comes first.
    """
    wide = cost.shape[0] <= cost.shape[1]
    table = np.ascontiguousarray(cost if wide else cost.T, np.float64)
    if not np.isfinite(table).all():
        raise ValueError("costs of an assignment must be finite")
    columns = columns_of_rows(table)
    if wide:
        return np.arange(len(columns)), columns
    order = np.argsort(columns, kind="stable")
    return columns[order], order


@_jit
def columns_of_rows(cost: Array) -> Array:
    """The column (N,) of each row of a finite cost (N, M) with N <= M."""
    rows, columns = cost.shape
    row_price, column_price = np.zeros(rows), np.zeros(columns)
    column_of, row_of = np.full(rows, -1, np.int64), np.full(columns, -1, np.int64)
    before, left = np.empty(columns, np.int64), np.empty(columns, np.int64)
    lengths = np.empty(columns)
    for row in range(rows):
        lengths[:] = np.inf
        for k in range(columns):
            left[k] = columns - 1 - k
        count, at, length, end = columns, row, 0.0, -1
        while end < 0:  # the shortest path from this row to a free column
            nearest, chosen = np.inf, -1
            for k in range(count):
                column = left[k]
                reached = length + cost[at, column] - row_price[at] - column_price[column]
                if reached < lengths[column]:
                    before[column], lengths[column] = at, reached
                if lengths[column] < nearest or (lengths[column] == nearest and row_of[column] < 0):
                    nearest, chosen = lengths[column], k
            length, column = nearest, left[chosen]
            if row_of[column] < 0:
                end = column
            else:
                at = row_of[column]
            count -= 1
            left[chosen] = left[count]
            left[count] = column  # those that were passed stand at the end
        row_price[row] += length
        for k in range(count, columns):
            column = left[k]
            if column != end:
                row_price[row_of[column]] += length - lengths[column]
            column_price[column] -= length - lengths[column]
        while True:
            at = before[end]
            row_of[end] = at
            column_of[at], end = end, column_of[at]
            if at == row:
                break
    return column_of
