"""Against numpy, on random numbers with many equal ones."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from panoptic_ros.kernels.order import descending, median, nth_smallest

NUMBERS = st.lists(st.integers(-4, 4).map(float) | st.floats(-1e6, 1e6), min_size=1, max_size=40)


@given(NUMBERS)
def test_median(numbers):
    assert median(np.array(numbers)) == np.median(numbers)


@given(NUMBERS, st.data())
def test_nth_smallest_parts_the_numbers(numbers, data):
    n = data.draw(st.integers(0, len(numbers) - 1))
    values = np.array(numbers)
    found = nth_smallest(values, n)
    assert found == np.sort(numbers)[n]
    assert (values[:n] <= found).all() and (values[n:] >= found).all()
    assert sorted(values) == sorted(numbers)


@given(NUMBERS)
def test_descending_is_stable(numbers):
    expected = np.argsort(-np.array(numbers), kind="stable")
    np.testing.assert_array_equal(descending(np.array(numbers)), expected)


@pytest.mark.parametrize("count", [0, 1, 2, 1000])
def test_descending_of_few_and_many(count):
    numbers = np.random.default_rng(0).normal(size=count).round(1)
    np.testing.assert_array_equal(descending(numbers), np.argsort(-numbers, kind="stable"))
