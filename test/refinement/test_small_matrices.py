"""Factors of small matrices against numpy."""

import numpy as np
import pytest

from panoptic_ros.refinement.motion_model import SIX
from panoptic_ros.refinement.small_matrices import cholesky, solve, whiten, whitened_row


def positive(size, seed=0):
    factor = np.random.default_rng(seed).standard_normal((size, size))
    return factor @ factor.T + 0.1 * np.eye(size)


@pytest.mark.parametrize("size", [3, 6])
@pytest.mark.parametrize("inverted", [False, True])
def test_factors_are_those_of_numpy(size, inverted):
    matrix, lower = positive(size), np.zeros((size, size))
    cholesky(matrix, lower, inverted)
    if inverted:
        lower[range(size), range(size)] **= -1
    assert np.allclose(lower, np.linalg.cholesky(matrix))


def test_what_is_singular_has_a_finite_factor():
    axis, lower = np.array([1.0, -2.0, 0.5]), np.zeros((3, 3))
    cholesky(np.outer(axis, axis), lower, False)
    assert np.allclose(lower @ lower.T, np.outer(axis, axis), atol=1e-7) and np.isfinite(lower).all()


def test_whitened_vectors_have_variance_one():
    matrix, lower, vector, result = positive(3), np.zeros((3, 3)), np.array([1.0, 2.0, -3.0]), np.empty(3)
    cholesky(matrix, lower, False)
    whiten(lower, vector, result)
    assert np.isclose(result @ result, vector @ np.linalg.solve(matrix, vector))
    for k in range(3):
        row = np.full(6, np.nan)
        whitened_row(lower, k, row)
        assert np.isclose(row[:3] @ vector, result[k]) and not row[3:].any()


def test_columns_are_solved_for():
    matrix, columns = positive(6), np.random.default_rng(1).standard_normal((6, 6))
    found = columns.copy()
    solve(SIX, matrix, found, np.empty((6, 6)))
    assert np.allclose(matrix @ found, columns)
