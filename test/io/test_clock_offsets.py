"""Saved clock offsets."""

import json
from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.domain import ClockModel
from panoptic_ros.errors import DataError
from panoptic_ros.io.clock_offsets import read_offsets, write_clocks, write_models
from panoptic_ros.offsets import CameraClocks


def test_an_estimate_comes_back_where_it_is_applied(tmp_path):
    clocks = replace(
        CameraClocks.unknown(("a", "b"), 10**9),
        offsets=np.array([0.03, 0.04]),
        drifts=np.array([4e-5, 0.0]),
        covariance=np.diag([1e-8, 1e-8, 1e-10, 1e-10]),
        known=np.array([True, False]),
    )
    write_clocks(tmp_path / "o.json", clocks)
    saved = read_offsets(tmp_path / "o.json")
    assert list(saved) == ["a"]
    assert saved["a"].offset_s == 0.03 and saved["a"].offset_std_s == pytest.approx(1e-4)
    assert saved["a"].drifts  # 4e-5 +- 1e-5


def test_clocks_of_a_run_come_back_with_the_delays_that_they_came_on_top_of(tmp_path):
    model = ClockModel("a", 10**9, 2e6, 1e-5, np.diag([1e-8, 1e-10]))
    write_models(tmp_path / "o.json", {"a": model}, {"a": 30.0, "b": -5.0})
    saved = read_offsets(tmp_path / "o.json")
    assert saved["a"].offset_s == pytest.approx(0.032) and saved["b"].offset_s == pytest.approx(-0.005)
    assert saved["a"].offset_std_s == pytest.approx(1e-4) and saved["b"].offset_std_s == 0.0
    assert not saved["a"].drifts  # 1e-5 +- 1e-5


@pytest.mark.parametrize(
    ("document", "told"),
    [
        ([], "no panoptic-offsets-1"),
        ({"format": "other"}, "no panoptic-offsets-1"),
        ({"format": "panoptic-offsets-1"}, "cameras"),
        ({"format": "panoptic-offsets-1", "cameras": [{"name": "a", "applied": True}]}, "offset_s"),
        (
            {
                "format": "panoptic-offsets-1",
                "cameras": [
                    {
                        "name": "a",
                        "applied": True,
                        "offset_s": float("nan"),
                        "offset_std_s": 0.0,
                        "drift": 0.0,
                        "drift_std": 0.0,
                    }
                ],
            },
            "offset_s of a is nan",
        ),
    ],
)
def test_other_files_are_refused(tmp_path, document, told):
    path = tmp_path / "o.json"
    path.write_text(json.dumps(document))
    with pytest.raises(DataError, match=told) as error:
        read_offsets(path)
    assert "o.json" in str(error.value)
