"""Medians are those of NumPy, also with values that are missing."""

import warnings

import numpy as np
import pytest

from panoptic_ros.geometry.medians import finite_median, row_medians


@pytest.mark.parametrize("seed", range(5))
def test_medians_are_those_of_the_known_values(seed):
    rng = np.random.default_rng(seed)
    values = np.where(rng.random((30, 1 + seed)) < 0.4, np.nan, rng.normal(size=(30, 1 + seed)))
    values[0] = np.nan
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # rows without a value
        right = np.nanmedian(values, axis=1)
    assert np.array_equal(row_medians(values), right, equal_nan=True)
    assert np.array_equal([finite_median(row) for row in values], right, equal_nan=True)


def test_infinite_values_are_not_finite():
    assert finite_median(np.array([np.inf, 3.0, -np.inf, 1.0, 8.0])) == 3.0
    assert row_medians(np.array([[np.inf, 3.0, 1.0]])).tolist() == [3.0]
