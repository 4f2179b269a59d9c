"""Compiled functions on symmetric matrices: 3x3 matrices, and large sparse ones."""

from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit


@njit(cache=True, error_model="numpy")
def solve_symmetric(lower, right):
    """Return whether a symmetric 3x3 matrix is positive definite, and the solution (by L D L^T).

    Args:
        lower: Its lower triangle, row by row, six numbers.
        right: Right-hand side, three numbers.

    Returns:
        whether it is positive definite, and the three numbers of the solution, 0 if it is not.
    """
    n00, n10, n11, n20, n21, n22 = lower
    b0, b1, b2 = right
    if n00 <= 0.0:
        return False, 0.0, 0.0, 0.0
    i0 = 1.0 / n00
    l10, l20 = n10 * i0, n20 * i0
    d1 = n11 - l10 * n10
    if d1 <= 0.0:
        return False, 0.0, 0.0, 0.0
    i1 = 1.0 / d1
    rest = n21 - l20 * n10
    l21 = rest * i1
    d2 = n22 - l20 * n20 - l21 * rest
    if d2 <= 0.0:
        return False, 0.0, 0.0, 0.0
    y1 = b1 - l10 * b0
    s2 = (b2 - l20 * b0 - l21 * y1) / d2
    s1 = y1 * i1 - l21 * s2
    return True, b0 * i0 - l10 * s1 - l20 * s2, s1, s2


@njit(cache=True, error_model="numpy")
def invert_symmetric(lower, factor, result):
    """Write factor * inverse of the symmetric matrix `lower` to result (3, 3).

    1e-9 of the trace is added to the diagonal first. The result stays untouched if the trace is not positive.
    """
    scale = lower[0, 0] + lower[1, 1] + lower[2, 2]
    if not scale > 0.0:
        return
    a, b, c = lower[0, 0] + 1e-9 * scale, lower[1, 0], lower[2, 0]
    d, e, f = lower[1, 1] + 1e-9 * scale, lower[2, 1], lower[2, 2] + 1e-9 * scale
    l10, l20 = b / a, c / a
    d1 = d - l10 * b
    rest = e - l20 * b
    l21 = rest / d1
    d2 = f - l20 * c - l21 * rest
    m20 = l10 * l21 - l20  # last row of L^-1, and of (L D L^T)^-1 / d2
    i2, i1, i0 = factor / d2, factor / d1, factor / a
    result[2, 2] = i2
    result[2, 1] = result[1, 2] = -l21 * i2
    result[2, 0] = result[0, 2] = m20 * i2
    result[1, 1] = i1 + l21 * l21 * i2
    result[1, 0] = result[0, 1] = -l10 * i1 - l21 * m20 * i2
    result[0, 0] = i0 + l10 * l10 * i1 + m20 * m20 * i2


@njit(cache=True, error_model="numpy")
def largest_eigenvalue(matrix):
    """Return the largest eigenvalue of a symmetric 3x3 matrix, in closed form (Smith 1961)."""
    mean = (matrix[0, 0] + matrix[1, 1] + matrix[2, 2]) / 3.0
    a, d, f = matrix[0, 0] - mean, matrix[1, 1] - mean, matrix[2, 2] - mean
    b, c, e = matrix[1, 0], matrix[2, 0], matrix[2, 1]
    square = (a * a + d * d + f * f + 2.0 * (b * b + c * c + e * e)) / 6.0
    if square <= 0.0:
        return mean
    length = np.sqrt(square)
    determinant = a * (d * f - e * e) - b * (b * f - c * e) + c * (b * e - c * d)
    cosine = min(1.0, max(-1.0, 0.5 * determinant / (length * square)))
    return mean + 2.0 * length * np.cos(np.arccos(cosine) / 3.0)


@njit(cache=True, error_model="numpy")
def factor(matrix, begins):
    """Compute the Cholesky factor of a matrix (N, N) in its lower triangle.

    Args:
        matrix: (N, N), overwritten by the factor.
        begins: (N,) output, first non-zero column of each row. All entries before it are 0, and stay 0.
    """
    for i in range(len(matrix)):
        begins[i] = 0
        while matrix[i, begins[i]] == 0.0:
            begins[i] += 1
        for k in range(begins[i], i + 1):
            value = matrix[i, k]
            for m in range(max(begins[i], begins[k]), k):
                value -= matrix[i, m] * matrix[k, m]
            matrix[i, k] = np.sqrt(value) if k == i else value / matrix[k, k]


@njit(cache=True, error_model="numpy")
def solve_lower(lower, begins, vector, start):
    """Replace vector (N,) by L^-1 vector, in place; it must be 0 before index `start`."""
    for i in range(start, len(vector)):
        for m in range(max(begins[i], start), i):
            vector[i] -= lower[i, m] * vector[m]
        vector[i] /= lower[i, i]


@njit(cache=True, error_model="numpy")
def solve_upper(lower, begins, vector):
    """Replace vector (N,) by L^-T vector, in place."""
    for i in range(len(vector) - 1, -1, -1):
        vector[i] /= lower[i, i]
        for m in range(begins[i], i):
            vector[m] -= lower[i, m] * vector[i]
