"""Truncated costs: as they are below the limit, hardly more beyond it, and never alike."""
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from panoptic_ros.solving.truncation import truncated

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
