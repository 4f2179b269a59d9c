"""The bench of the viewer: what it plays, and the table of what came of it."""

import numpy as np
import pytest
from recorded_scene import write_scene

from panoptic_ros.errors import UsageError
from panoptic_ros.study.live.view_feed import PEOPLE, VIEWS, moving_previews, view_load
from panoptic_ros.study.names import parsed
from panoptic_ros.study.study import run_study


def test_the_load_is_that_of_the_bar():
    feed = view_load()
    assert len(feed.rig) == VIEWS and feed.rate == 30.0
    assert {len(found.views) for found in feed.sets} == {VIEWS} and feed.title.endswith(f"{PEOPLE} people")
    first, second = moving_previews(feed.rig, 2)
    assert set(first) == set(feed.rig.names) and all(first[name].jpeg != second[name].jpeg for name in first)
    assert 6_000 < np.mean([len(preview.jpeg) for preview in first.values()]) < 16_000


def test_times_and_rounds_that_make_no_sense_are_told():
    with pytest.raises(UsageError, match="--seconds: '1' is not a number from 2 to 600"):
        parsed("view", ["--seconds", "1"])
    with pytest.raises(UsageError, match="--rounds: '0' is not a whole number from 1 to 100"):
        parsed("view", ["--rounds", "0"])


def test_the_table():
    row = {
        "audience": "one",
        "messages": 90,
        "lost": 0,
        "skeletons_p50_ms": 1.0,
        "skeletons_p99_ms": 2.0,
        "p99_ratio": 1.1,
        "ratio_low": 0.9,
        "ratio_high": 1.3,
        "publish_p50_ms": 0.1,
        "publish_p99_ms": 0.2,
        "viewer_cpu_percent": 5.0,
        "viewer_mb": 90.0,
        "clients": [
            {
                "kind": "fast",
                "packets": 90,
                "age_p50_ms": 3.0,
                "age_p99_ms": 7.0,
                "age_max_ms": 9.0,
                "megabytes_per_s": 2.0,
                "skipped": 4,
            },
        ],
    }
    told = list(parsed("view", []).lines({"cores": 2, "load": 1.0, "rows": [row]}))
    assert any(line.startswith("one: fast") and "7.0" in line for line in told)
    assert any(line.startswith("p99 / without audience") and "1.10" in line for line in told)


def test_a_recording_is_opened_and_sought_in(tmp_path):
    write_scene(tmp_path / "bag", 60)
    study = parsed("view-recording", ["--recording", str(tmp_path / "bag")])
    (result,) = run_study(study)["rows"]
    assert result["address_s"] < result["first_s"] and result["seconds"] == 1
    assert 0.0 < result["seek_p50_ms"] <= result["seek_max_ms"]
    assert len(study.lines({"rows": [result]})) == 2
