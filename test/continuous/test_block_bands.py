"""Block bands: factor, solution and covariances against dense matrices."""

import numpy as np
import pytest
from scipy.linalg import LinAlgError

from panoptic_ros.continuous.block_bands import covariances_in_band, factor_blocks, solve_blocks

COUNT, SIZE = 9, 4


def dense_and_blocks(reach):
    """Random matrix, and its lower band of blocks."""
    rng = np.random.default_rng(reach)
    dense = np.zeros((COUNT * SIZE, COUNT * SIZE))
    for k in range(COUNT):
        rows = slice(k * SIZE, min(k + reach + 1, COUNT) * SIZE)
        some = rng.normal(size=(rows.stop - rows.start, 3))
        dense[rows, rows] += some @ some.T + 0.1 * np.eye(len(some))
    shaped = dense.reshape(COUNT, SIZE, COUNT, SIZE)
    blocks = np.zeros((COUNT, reach + 1, SIZE, SIZE))
    for k in range(COUNT):
        for p in range(min(reach + 1, COUNT - k)):
            blocks[k, p] = shaped[k + p, :, k]
    return dense, blocks


@pytest.mark.parametrize("reach", [1, 3, 12])
def test_solution_and_covariances_are_those_of_the_dense_matrix(reach):
    dense, factor = dense_and_blocks(reach)
    factor[:, 0] = np.tril(factor[:, 0])  # the upper triangle is not read
    factor_blocks(factor)
    right = np.random.default_rng(0).normal(size=(COUNT, SIZE))
    solution = np.linalg.solve(dense, right.ravel())
    np.testing.assert_allclose(solve_blocks(factor, right).ravel(), solution, rtol=1e-9)
    inverse = np.linalg.inv(dense).reshape(COUNT, SIZE, COUNT, SIZE)
    for k, here, cross, later in covariances_in_band(factor):
        np.testing.assert_allclose(here, inverse[k, :, k], rtol=1e-9)
        for m in range(k + 1, min(k + reach + 1, COUNT)):
            np.testing.assert_allclose(cross[m % reach], inverse[m, :, k], atol=1e-9)
            for n in range(k + 1, min(k + reach + 1, COUNT)):
                np.testing.assert_allclose(later[m % reach, :, n % reach], inverse[m, :, n], atol=1e-9)


def test_an_indefinite_matrix_is_refused():
    _, blocks = dense_and_blocks(2)
    blocks[4, 0] -= 100.0 * np.eye(SIZE)
    with pytest.raises(LinAlgError):
        factor_blocks(blocks)
