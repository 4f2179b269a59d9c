"""Kernels for symmetric banded systems: Cholesky factor, solution, and the part of the inverse in the band.

A matrix (n, n) of half bandwidth b is stored as its lower band (n, b + 1): band[i, k] = A[i, i - k].
"""

from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit


@njit(cache=True, error_model="numpy")
def factor(band):
    """Replace the band of A by that of its Cholesky factor L, A = L L^T.

    Returns: False if A is not positive definite.
    """
    n, width = band.shape
    column = np.zeros(2 * width)  # reversed: column[width - 1 - c] = L[j + c, j]. Inner loops are contiguous
    for j in range(n):
        if not band[j, 0] > 0.0:
            return False
        band[j, 0] = np.sqrt(band[j, 0])
        scale = 1.0 / band[j, 0]
        for c in range(1, min(width, n - j)):
            column[width - 1 - c] = band[j + c, c] * scale
        for c in range(1, min(width, n - j)):
            row, first = band[j + c], width - 1 - c
            row[c] = value = column[first]
            for e in range(c):
                row[e] -= value * column[first + e]
    return True


@njit(cache=True, error_model="numpy")
def forward(lower, right):
    """Solve L x = right for right (n, m), and write x to `right`."""
    n, width = lower.shape
    for i in range(n):
        for k in range(1, min(width, i + 1)):
            scale = lower[i, k]
            if scale != 0.0:
                for c in range(right.shape[1]):
                    right[i, c] -= scale * right[i - k, c]
        scale = 1.0 / lower[i, 0]
        for c in range(right.shape[1]):
            right[i, c] *= scale


@njit(cache=True, error_model="numpy")
def forward_vector(lower, right):
    """Solve L x = right for right (n,), and write x to `right`."""
    n, width = lower.shape
    for i in range(n):
        value = right[i]
        for k in range(1, min(width, i + 1)):
            value -= lower[i, k] * right[i - k]
        right[i] = value / lower[i, 0]


@njit(cache=True, error_model="numpy")
def backward(lower, right):
    """Solve L^T x = right for right (n,), and write x to `right`."""
    n, width = lower.shape
    for i in range(n - 1, -1, -1):
        row = lower[i]
        right[i] = value = right[i] / row[0]
        for k in range(1, min(width, i + 1)):
            right[i - k] -= row[k] * value


@njit(cache=True, error_model="numpy")
def inverse_in_band(lower):
    """Return the entries of A^-1 inside the band (n, b + 1), from the factor (Takahashi's recursion)."""
    n, width = lower.shape
    inverse = np.zeros((n, width))
    # covariances of the rows below, each in the slot of its remainder, so that nothing moves
    window, gain, own = np.zeros((width, width)), np.zeros(width), np.zeros(width)
    for j in range(n - 1, -1, -1):
        scale, slot = 1.0 / lower[j, 0], j % width
        gain[slot] = 0.0
        for i in range(j + 1, min(n, j + width)):
            gain[i % width] = lower[i, i - j] * scale
        own[:] = 0.0
        for m in range(width):
            value = gain[m]
            for i in range(width):
                own[i] -= value * window[m, i]
        variance = scale * scale
        for m in range(width):
            variance -= gain[m] * own[m]
        own[slot] = variance
        window[slot], window[:, slot] = own, own
        for i in range(j, min(n, j + width)):
            inverse[i, i - j] = own[i % width]
    return inverse
