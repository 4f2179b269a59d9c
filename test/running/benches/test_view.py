"""The bench of the viewer: what it plays, and the table of what came of it."""
import argparse

import numpy as np
import pytest
from recorded_scene import write_scene

from panoptic_ros.bench.view_feed import PEOPLE, VIEWS, view_load
from panoptic_ros.errors import UsageError
from panoptic_ros.running.benches.view import lines, measure


def test_the_load_is_that_of_the_bar():
    feed, instants = view_load(7)
    assert len(feed.rig) == VIEWS and feed.rate == 30.0
    for number, instant in enumerate(instants):
        assert len(instant.skeletons.ids) == PEOPLE and len(instant.views) == VIEWS
        assert len(instant.previews) == (VIEWS if number % 3 == 0 else 0)
        assert {view.frame_number for view in instant.views} == {number}
        assert instant.skeletons.sources.cameras == feed.rig.names
    sizes = [len(preview.jpeg) for preview in instants[0].previews]
    assert 6_000 < np.mean(sizes) < 16_000


def test_a_time_that_makes_no_sense_is_told():
    with pytest.raises(UsageError, match="--seconds 1: give 2 to 600"):
        measure(argparse.Namespace(seconds=1.0, recording=None))


def test_the_table():
    row = {
        "audience": "one", "lost": 0, "skeletons_p50_ms": 1.0, "skeletons_p99_ms": 2.0, "publish_p50_ms": 0.1,
        "publish_p99_ms": 0.2, "viewer_cpu_percent": 5.0, "viewer_mb": 90.0,
        "clients": [
            {"kind": "fast", "packets": 90, "age_p50_ms": 3.0, "age_p99_ms": 7.0, "age_max_ms": 9.0,
             "megabytes_per_s": 2.0, "skipped": 4},
            {"kind": "cut", "packets": 0, "age_p50_ms": None, "age_p99_ms": None, "age_max_ms": None,
             "megabytes_per_s": 0.0, "skipped": 0},
        ],
    }  # fmt: skip
    about = {"people": 8, "views": 8, "rate_hz": 30.0, "seconds": 5.0, "cores": 2, "load": 1.0}
    told = lines({**about, "rows": [row]})
    assert any(line.startswith("one: fast") and "7.0" in line for line in told)
    assert not any("cut" in line for line in told)


def test_a_recording_is_opened_and_sought_in(tmp_path):
    write_scene(tmp_path / "bag", 60)
    result = measure(argparse.Namespace(seconds=8.0, recording=tmp_path / "bag"))
    assert result["address_s"] < result["first_s"] and result["seconds"] == 1
    assert 0.0 < result["seek_p50_ms"] <= result["seek_max_ms"]
    assert len(lines(result)) == 3
