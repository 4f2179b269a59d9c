"""Large residuals count less; truncated costs are hardly more beyond the limit, and never alike."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from panoptic_ros.geometry.robust import covariance_correction, growth, relative_growth, truncated

costs = st.floats(0.0, 1e6)


@given(costs, st.floats(0.1, 100.0))
def test_costs_are_kept_below_the_limit_and_cut_beyond(cost, limit):
    found = truncated(cost, limit)
    assert found == cost if cost < limit else limit <= found <= 1.000001 * limit


@given(st.floats(16.1, 1e5), st.floats(1.01, 10.0))
def test_of_two_hopeless_costs_the_lower_stays_lower(cost, times):
    assert truncated(cost, 16.0) < truncated(times * cost, 16.0)


def test_behind_a_camera_is_as_bad_as_it_gets():
    assert truncated(np.inf, 16.0) == 16.0 * 1.000001


@given(st.floats(0.0, 1e4), st.floats(0.5, 100.0))
def test_residuals_make_their_measurement_noisier(squared, scale):
    assert np.isclose(1.0 / growth(squared, scale), scale**2 / (scale**2 + squared))  # Cauchy's weight
    assert np.isclose(relative_growth(1.0, scale), 1.0)


@pytest.mark.parametrize("scale", [1.5, 3.0, 100.0])
def test_the_covariance_of_robust_means_is_right(scale):
    rng = np.random.default_rng(5)
    points = rng.normal(size=(20_000, 40, 2))
    means = np.zeros((20_000, 2))
    for _ in range(30):
        weights = 1.0 / growth(((points - means[:, None]) ** 2).sum(axis=2), scale)
        means = (weights[..., None] * points).sum(axis=1) / weights.sum(axis=1)[:, None]
    stated = covariance_correction(scale) / weights.sum(axis=1).mean()
    assert np.isclose(stated, (means**2).mean(), rtol=0.04)
