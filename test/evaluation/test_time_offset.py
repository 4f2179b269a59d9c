"""A constant offset of the result's clock is found from the motion."""

from __future__ import annotations

import pytest

from panoptic_ros.errors import DataError
from panoptic_ros.evaluation import evaluate, find_time_offset, shifted


@pytest.mark.parametrize("seconds", [0.0, 0.083, -0.12])
def test_the_offset_is_found_and_removed(build, seconds):
    truth = build.walk(40)
    late = shifted(truth, seconds)
    found = find_time_offset(truth, late)
    assert found.seconds == pytest.approx(-seconds, abs=1e-3)
    assert found.error_before == pytest.approx(abs(seconds), abs=1e-3)  # people walk at 1 m/s
    assert evaluate(truth, shifted(late, found.seconds)).joints.median_mm < 2.0


def test_nobody_near_the_truth(build):
    with pytest.raises(DataError, match="offset cannot be found"):
        find_time_offset(build.walk(), build.walk(offset=(0.0, 0.0, 9.0)))
