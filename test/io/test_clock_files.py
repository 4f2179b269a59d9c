"""Files of clocks and line delays."""

import json
from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.continuous.clocks import CameraTimes
from panoptic_ros.continuous.motion_result import ContinuousMotion
from panoptic_ros.domain import ClockModel, StampLine
from panoptic_ros.errors import DataError
from panoptic_ros.io.clock_files import (
    SavedClock,
    read_clocks,
    write_camera_times,
    write_clocks,
    write_models,
)
from panoptic_ros.io.known_keys import UnknownKeyWarning
from panoptic_ros.offsets.clocks import CameraClocks

START = 10**11
CLOCK = {"offset_s": 0.01, "drift_ppm": 20.0}


def document(path):
    return json.loads(path.read_text())


def test_an_estimate_comes_back_where_it_was_observable(tmp_path):
    clocks = replace(
        CameraClocks.unknown(("a", "b", "c"), START),
        offsets=np.array([0.03, 0.04, 1e-5]),
        drifts=np.array([4e-5, 0.0, 0.0]),
        covariance=np.diag([1e-8, 1e-8, 1e-8, 1e-10, 1e-10, 1e-10]),
        known=np.array([True, False, True]),
    )
    write_clocks(tmp_path / "o.json", clocks, START)
    assert document(tmp_path / "o.json")["format"] == "panoptic-clocks-1"
    cameras = document(tmp_path / "o.json")["cameras"]
    assert [cameras[name]["observable"] for name in "abc"] == [True, False, True]
    saved = read_clocks(tmp_path / "o.json")
    assert list(saved) == ["a", "c"]
    assert saved["a"].offset_s == 0.03 and saved["a"].offset_sd_s == pytest.approx(1e-4)
    assert saved["a"].drift == pytest.approx(4e-5) and saved["a"].drifts  # 4e-5 +- 1e-5
    assert saved["a"].reference_ns == START and saved["a"].line_delay_us is None
    assert not saved["c"].drifts


def test_offsets_hold_at_the_reference_that_is_written(tmp_path):
    clocks = replace(
        CameraClocks.unknown(("a",), START),
        offsets=np.array([0.03]),
        drifts=np.array([1e-4]),
        covariance=np.diag([1e-8, 1e-10]),
        known=np.ones(1, bool),
    )
    write_clocks(tmp_path / "o.json", clocks, START - 50 * 10**9)
    (saved,) = read_clocks(tmp_path / "o.json").values()
    assert saved.offset_s == pytest.approx(0.03 - 50.0 * 1e-4)
    assert saved.offset_sd_s == pytest.approx(np.hypot(1e-4, 50.0 * 1e-5))
    line = saved.line(0, drifting=True)
    assert line.corrected(START) == pytest.approx(START + 30_000_000, abs=1)
    assert saved.line(0, drifting=False).corrected(START) == START + 25_000_000


def test_clocks_of_a_run_come_back_with_the_delays_that_they_came_on_top_of(tmp_path):
    models = {
        "a": ClockModel("a", START, 2e6, 1e-5, np.diag([1e-8, 1e-10])),
        "c": ClockModel("c", START - 10**9, -3e6, 1e-4, np.diag([1e-8, 0.0])),
    }
    delays = {"a": StampLine(START, 30_000_000), "b": StampLine(START - 10**9, -5_000_000, 1e-4)}
    write_models(tmp_path / "o.json", models, delays)
    saved = read_clocks(tmp_path / "o.json")
    assert {clock.reference_ns for clock in saved.values()} == {START}
    assert saved["a"].offset_s == pytest.approx(0.032) and saved["b"].offset_s == pytest.approx(-0.0049)
    assert saved["b"].drift == pytest.approx(1e-4)
    assert saved["a"].offset_sd_s == pytest.approx(1e-4) and saved["b"].offset_sd_s == 0.0
    assert not saved["a"].drifts  # 1e-5 +- 1e-5
    assert saved["c"].offset_s == pytest.approx(-0.003 + 1e-4) and saved["c"].drift == pytest.approx(1e-4)


def test_clocks_and_line_delays_of_a_continuous_motion_come_back(tmp_path):
    reference = START + 5 * 10**9
    values = np.array([[0.02, 0.0, -0.01], [1e-4, 0.0, 0.0], [2e-5, 0.0, 1e-5]])
    variances = np.array([[1e-8, 1e-8, 1e-2], [1e-12, 1e-12, 1e-8], [1e-12, 0.0, 1e-12]])
    clocks = CameraTimes(values, np.diag(variances.ravel()))
    motion = ContinuousMotion((), reference, START, START + 10**10, 0.04, ("a", "b", "c"), clocks, "", 19)
    write_camera_times(tmp_path / "k.json", motion)
    assert not document(tmp_path / "k.json")["cameras"]["c"]["observable"]
    saved = read_clocks(tmp_path / "k.json")
    assert list(saved) == ["a", "b"]
    a = saved["a"]
    assert a.reference_ns == START and a.offset_s == pytest.approx(0.02 - 5.0 * 1e-4)
    assert a.offset_sd_s == pytest.approx(np.sqrt(1e-8 + 25e-12))
    assert a.drift == pytest.approx(1e-4) and a.drift_sd == pytest.approx(1e-6)
    assert a.line_delay_us == pytest.approx(20.0) and a.line_delay_sd_us == pytest.approx(1.0)


def test_a_file_of_the_older_format_is_read_where_it_was_applied(tmp_path):
    rows = [
        {"name": "a", "applied": True, "known": True, "offset_s": 0.03, "offset_std_s": 1e-4, "drift": 4e-5},
        {"name": "b", "applied": False, "offset_s": 0.04},
        {"name": "c", "applied": True, "offset_s": -0.01, "drift": 1e-5, "reference_ns": 7},
    ]
    older = {"format": "panoptic-offsets-1", "reference_ns": 5, "iterations": 3, "cameras": rows}
    (tmp_path / "o.json").write_text(json.dumps(older))
    assert read_clocks(tmp_path / "o.json") == {
        "a": SavedClock(0.03, 1e-4, 4e-5, 0.0, 5),
        "c": SavedClock(-0.01, 0.0, 1e-5, 0.0, 7),
    }
    del older["reference_ns"]
    (tmp_path / "o.json").write_text(json.dumps(older))
    assert read_clocks(tmp_path / "o.json")["a"] == SavedClock(0.03, 1e-4)  # it cannot be told what drifted


def test_a_file_needs_offsets_only(tmp_path):
    """Without a reference, offsets hold at the first timestamp of the recording."""
    (tmp_path / "k.json").write_text('{"format": "panoptic-clocks-1", "cameras": {"a": {"offset_s": 0.02}}}')
    saved = read_clocks(tmp_path / "k.json")
    assert saved == {"a": SavedClock(0.02)}
    assert replace(saved["a"], drift=1e-3).line(START, True).corrected(START + 10**9) == START + 1_021_000_000


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ([], "not a panoptic-clocks-1"),
        ({"format": "other"}, "not a panoptic-clocks-1"),
        ({"format": "panoptic-clocks-1"}, "'cameras' is missing"),
        ({"format": "panoptic-clocks-1", "cameras": []}, "a table is expected"),
        ({"format": "panoptic-clocks-1", "cameras": {"a": 0.01}}, "a table is expected"),
        ({"format": "panoptic-clocks-1", "cameras": {"a": {}}}, "offset_s of a is missing"),
        (
            {"format": "panoptic-clocks-1", "cameras": {"a": {"offset_s": float("nan")}}},
            "offset_s of a is nan",
        ),
        ({"format": "panoptic-clocks-1", "cameras": {"a": {"offset_s": 1e12}}}, "at most 4e+09"),
        ({"format": "panoptic-clocks-1", "cameras": {"a": {**CLOCK, "drift_ppm": 1e6}}}, "at most 5000"),
        ({"format": "panoptic-clocks-1", "cameras": {"a": {**CLOCK, "observable": 1}}}, "true or false"),
        (
            {"format": "panoptic-clocks-1", "reference_ns": 0.5, "cameras": {"a": CLOCK}},
            "reference_ns is 0.5",
        ),
        ({"format": "panoptic-offsets-1"}, "cameras"),
        ({"format": "panoptic-offsets-1", "cameras": [{"name": "a", "applied": True}]}, "offset_s"),
        (
            {"format": "panoptic-offsets-1", "cameras": [{"name": "a", "applied": True, "offset_s": 1e999}]},
            "offset_s of a is inf",
        ),
    ],
)
def test_other_files_are_refused_in_one_line(tmp_path, content, told):
    path = tmp_path / "o.json"
    path.write_text(json.dumps(content))
    with pytest.raises(DataError) as error:
        read_clocks(path)
    text = str(error.value)
    assert told in text and "o.json" in text and "\n" not in text


def test_a_misspelt_key_is_told_with_the_nearest_one(tmp_path):
    clock = {**CLOCK, "line_dely_us": 20.0}
    content = {"format": "panoptic-clocks-1", "reference_ns": 0, "cameras": {"a": clock}}
    (tmp_path / "k.json").write_text(json.dumps(content))
    with pytest.warns(UnknownKeyWarning, match="line_dely_us.*line_delay_us"):
        assert read_clocks(tmp_path / "k.json")["a"].line_delay_us is None
