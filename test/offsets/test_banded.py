"""Banded kernels against dense algebra."""

import numpy as np
import pytest

from panoptic_ros.offsets.trajectories import backward, factor, forward, inverse_in_band


def banded(rng, n, width):
    matrix = rng.normal(size=(n, n))
    matrix = np.tril(np.triu(matrix, 1 - width), width - 1)
    matrix = matrix + matrix.T + 4.0 * width * np.eye(n)
    band = np.zeros((n, width))
    for i in range(n):
        for k in range(min(i, width - 1) + 1):
            band[i, k] = matrix[i, i - k]
    return matrix, band


@pytest.mark.parametrize("n", [3, 12, 40])
def test_solves_and_inverts_as_dense_algebra_does(n):
    rng = np.random.default_rng(n)
    matrix, band = banded(rng, n, 12)
    right = rng.normal(size=(n, 4))
    assert factor(band)
    half = right.copy()
    forward(band, half)
    np.testing.assert_allclose(half.T @ half, right.T @ np.linalg.solve(matrix, right), rtol=1e-10)
    column = half[:, 0].copy()
    backward(band, column)
    np.testing.assert_allclose(matrix @ column, right[:, 0], atol=1e-10)
    inverse, found = np.linalg.inv(matrix), inverse_in_band(band)
    for i in range(n):
        for k in range(min(i, 11) + 1):
            assert found[i, k] == pytest.approx(inverse[i, i - k], abs=1e-12)


def test_says_when_a_matrix_is_not_positive():
    band = np.zeros((4, 12))
    band[:, 0] = (1.0, 2.0, -1.0, 1.0)
    assert not factor(band)
