"""Symmetric matrices against numpy."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from panoptic_ros.geometry.symmetric import (
    factor,
    invert_symmetric,
    largest_eigenvalue,
    solve_lower,
    solve_symmetric,
    solve_upper,
)


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 100_000))
def test_symmetric_solution_equals_numpy(seed):
    rng = np.random.default_rng(seed)
    root, right = rng.normal(size=(3, 3)), rng.normal(size=3)
    a = root @ root.T + 0.05 * np.eye(3)
    good, *x = solve_symmetric((a[0, 0], a[1, 0], a[1, 1], a[2, 0], a[2, 1], a[2, 2]), tuple(right))
    assert good and np.allclose(x, np.linalg.solve(a, right), rtol=1e-8, atol=1e-10)


def test_no_solution_where_the_matrix_is_not_positive():
    assert not solve_symmetric((1.0, 2.0, 1.0, 0.0, 0.0, 1.0), (1.0, 1.0, 1.0))[0]


def test_largest_eigenvalue():
    rng = np.random.default_rng(0)
    for scale in (np.ones(3), np.array([1.0, 1e-2, 1e-5])):
        root = rng.standard_normal((50, 3, 3)) * scale
        for matrix in np.swapaxes(root, 1, 2) @ root:
            assert np.isclose(largest_eigenvalue(matrix), np.linalg.eigvalsh(matrix)[-1], rtol=1e-9)
    assert largest_eigenvalue(2.0 * np.eye(3)) == 2.0


def test_inverse_of_a_lower_triangle():
    root = np.random.default_rng(1).standard_normal((4, 3))
    matrix, result = root.T @ root, np.zeros((3, 3))
    invert_symmetric(np.tril(matrix), 2.0, result)
    assert np.allclose(result, 2.0 * np.linalg.inv(matrix), rtol=1e-6)


def test_factor_of_a_matrix_with_few_entries():
    rng = np.random.default_rng(2)
    matrix = np.diag(rng.uniform(1.0, 2.0, 30))
    for _ in range(40):  # some ties between neighbours, some far
        i, k = rng.integers(0, 30, 2)
        tie = np.zeros(30)
        tie[i], tie[k] = 1.0, -0.5
        matrix += np.outer(tie, tie)
    lower, begins, right = matrix.copy(), np.zeros(30, np.int64), rng.standard_normal(30)
    factor(lower, begins)
    assert np.allclose(np.tril(lower), np.linalg.cholesky(matrix))
    found, half, late = right.copy(), right.copy(), np.zeros(30)
    solve_lower(lower, begins, half, 0)
    assert np.allclose(np.tril(lower) @ half, right)
    solve_lower(lower, begins, found, 0)
    solve_upper(lower, begins, found)
    assert np.allclose(matrix @ found, right)
    late[20] = 1.0
    solve_lower(lower, begins, late, 20)
    assert np.allclose(np.tril(lower) @ late, np.eye(30)[20])
