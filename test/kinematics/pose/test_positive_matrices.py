"""Against dense algebra."""

import numpy as np
import pytest

from panoptic_ros.errors import ContractError
from panoptic_ros.kinematics.pose.positive_matrices import factor_of, forward, inverse_of, solved_by


def test_factor_solution_and_inverse():
    rng = np.random.default_rng(0)
    wide, rows = rng.normal(size=(7, 9)), rng.normal(size=(7, 4))
    matrix = wide @ wide.T
    factor = factor_of(matrix)
    np.testing.assert_allclose(factor, np.linalg.cholesky(matrix))
    np.testing.assert_allclose(forward(factor, rows), np.linalg.solve(factor, rows))
    np.testing.assert_allclose(solved_by(factor, rows[:, 0]), np.linalg.solve(matrix, rows[:, 0]))
    np.testing.assert_allclose(inverse_of(matrix), np.linalg.inv(matrix))


def test_what_is_not_positive_is_a_fault():
    with pytest.raises(ContractError, match="7 rows is not positive"):
        inverse_of(-np.eye(7))
