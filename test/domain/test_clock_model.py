"""Clock models: whole nanoseconds at stamps since 1970, and uncertainty that grows in holdover."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from panoptic_ros.domain import ClockModel
from panoptic_ros.errors import DataError

EPOCH = 1_700_000_000_123_456_789


@given(
    offset=st.integers(-EPOCH, EPOCH),
    residual=st.floats(-5.0, 5.0),
    drift=st.floats(-2e-4, 2e-4),
    since=st.integers(0, 3600 * 10**9),
)
def test_master_time_is_exact_to_a_nanosecond(offset, residual, drift, since):
    model = ClockModel("a", EPOCH, offset, drift, np.zeros((2, 2)), residual)
    exact = Fraction(EPOCH + since + offset) + Fraction(residual) + Fraction(drift) * since
    assert abs(model.master_from_device(EPOCH + since)[0] - exact) <= 0.51
    assert abs(model.residual_ns) <= 0.5


def test_float_offsets_are_split():
    model = ClockModel("a", 5, -2.75, 0.0, np.zeros((2, 2)))
    assert (model.offset_ns, model.residual_ns) == (-3, 0.25)


def test_uncertainty_is_that_of_the_line_and_grows_in_holdover():
    second = 10**9
    covariance = np.diag([1e-6, 1e-7]) ** 2
    model = ClockModel("a", 10 * second, 0, 0.0, covariance, 0.0, 5 * second, 15 * second, wander=1e-6)
    assert model.master_from_device(10 * second)[1] == pytest.approx(1e3)
    assert model.master_from_device(15 * second)[1] == pytest.approx(1e3 * np.hypot(1, 0.5))
    assert model.master_from_device(115 * second)[1] == pytest.approx(1e3 * np.sqrt(1 + 10.5**2 + 100**2))
    assert model.master_from_device(0)[1] == pytest.approx(1e3 * np.sqrt(1 + 1 + 5**2))


@pytest.mark.parametrize(
    "change", [{"drift": np.nan}, {"wander": -1.0}, {"offset_ns": 2**63}, {"covariance": -np.eye(2)}]
)
def test_bad_numbers_are_refused(change):
    values = {"device": "a", "reference_ns": 0, "offset_ns": 0, "drift": 0.0, "covariance": np.eye(2)}
    with pytest.raises(DataError, match="clock model of a"):
        ClockModel(**{**values, **change})
