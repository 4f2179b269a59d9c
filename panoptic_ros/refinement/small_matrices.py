"""Cholesky factors of small positive matrices: 3x3 for positions, 6x6 or 9x9 for states; compiled."""

from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit

LEAST_PIVOT = 1e-16  # smallest pivot, for matrices that are singular up to rounding


@njit(cache=True, error_model="numpy")
def cholesky(matrix, lower, inverted):
    """Write the Cholesky factor of a matrix (S, S) = lower lower^T to `lower`.

    Elements above the diagonal are not written.

    Args:
        inverted: Whether the diagonal of `lower` is stored inverted, for callers that divide by it many
            times.
    """
    for i in range(len(matrix)):
        for k in range(i + 1):
            value = matrix[i, k]
            for m in range(k):
                value -= lower[i, m] * lower[k, m]
            if k < i:
                lower[i, k] = value * lower[k, k] if inverted else value / lower[k, k]
            else:
                pivot = np.sqrt(max(value, LEAST_PIVOT))
                lower[i, i] = 1.0 / pivot if inverted else pivot


@njit(cache=True, error_model="numpy")
def whiten(lower, vector, result):
    """Write lower^-1 vector (S,) to `result`."""
    for i in range(len(vector)):
        value = vector[i]
        for m in range(i):
            value -= lower[i, m] * result[m]
        result[i] = value / lower[i, i]


@njit(cache=True, error_model="numpy")
def whitened_row(lower, k, row):
    """Write row k of lower^-1 to `row` (S,): the solution r of lower^T r = e_k."""
    for i in range(len(row)):
        row[i] = 1.0 if i == k else 0.0
    for i in range(k, -1, -1):
        value = row[i]
        for m in range(i + 1, k + 1):
            value -= lower[m, i] * row[m]
        row[i] = value / lower[i, i]


@njit(cache=True, error_model="numpy")
def solve(sized, matrix, columns, lower):
    """Replace `columns` (S, S) by matrix^-1 columns.

    Args:
        sized: Sequence of length S.
        lower: (S, S), scratch.
    """
    size = len(sized)
    cholesky(matrix, lower, True)
    for i in range(size):
        for m in range(i):
            for c in range(size):
                columns[i, c] -= lower[i, m] * columns[m, c]
        for c in range(size):
            columns[i, c] *= lower[i, i]
    for i in range(size - 1, -1, -1):
        for m in range(i + 1, size):
            for c in range(size):
                columns[i, c] -= lower[m, i] * columns[m, c]
        for c in range(size):
            columns[i, c] *= lower[i, i]
