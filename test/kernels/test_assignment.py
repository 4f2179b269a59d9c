"""Against scipy, to the same pairs: costs with many ties, more rows or more columns."""

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from panoptic_ros.kernels.assignment import best_assignment


@pytest.mark.parametrize("seed", range(200))
def test_the_same_pairs(seed):
    rng = np.random.default_rng(seed)
    shape = rng.integers(0, 9, 2)
    cost = rng.integers(-3, 4, shape).astype(float) if seed % 2 else rng.normal(size=shape)
    if seed % 4 == 2:
        cost[rng.random(shape) < 0.5] = 1e6
    for found, expected in zip(best_assignment(cost), linear_sum_assignment(cost)):
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_costs_that_are_not_finite_are_refused(bad):
    with pytest.raises(ValueError, match="finite"):
        best_assignment(np.array([[1.0, bad]]))
