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
    for i in range(n):
        for k in range(min(i, width - 1), -1, -1):
            j = i - k
            value = band[i, k]
            for m in range(k + 1, min(width, i + 1)):
                if m - k < width:
                    value -= band[i, m] * band[j, m - k]
            if k > 0:
                band[i, k] = value / band[j, 0]
            elif value > 0.0:
                band[i, 0] = np.sqrt(value)
            else:
                return False
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
        value = right[i]
        for k in range(1, min(width, n - i)):
            value -= lower[i + k, k] * right[i + k]
        right[i] = value / lower[i, 0]


@njit(cache=True, error_model="numpy")
def inverse_in_band(lower):
    """Return the entries of A^-1 inside the band (n, b + 1), from the factor (Takahashi's recursion)."""
    n, width = lower.shape
    inverse = np.zeros((n, width))
    for j in range(n - 1, -1, -1):
        last = min(n - 1, j + width - 1)
        for i in range(last, j, -1):
            value = 0.0
            for m in range(j + 1, last + 1):
                value += lower[m, m - j] * (inverse[i, i - m] if i >= m else inverse[m, m - i])
            inverse[i, i - j] = -value / lower[j, 0]
        value = 1.0 / lower[j, 0]
        for m in range(j + 1, last + 1):
            value -= lower[m, m - j] * inverse[m, m - j]
        inverse[j, 0] = value / lower[j, 0]
    return inverse
