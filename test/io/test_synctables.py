"""Sync tables of Panoptic Studio: made here in the same form, with a Kinect whose color is 6.25 ms late."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from panoptic_ros.errors import DataError
from panoptic_ros.io.synctables import hd_time_ms, match_kinects, read_synctables


@pytest.fixture
def tables(tmp_path):
    hd = [53000.0 + k * 33.367 for k in range(40)]
    depth = [53004.0 + k * 33.334 for k in range(40)]
    color = [t + 6.25 for t in depth]
    depth[7] = color[9] = -1
    first, second = tmp_path / "synctables_x.json", tmp_path / "ksynctables_x.json"
    first.write_text(json.dumps({"hd": {"univ_time": hd}}))
    kinect = {
        "color": {"KINECTNODE1": {"univ_time": color, "index": list(range(100, 140))}},
        "depth": {"KINECTNODE1": {"univ_time": depth, "index": list(range(200, 240))}},
    }
    second.write_text(json.dumps({"kinect": kinect}))
    return first, second


def test_the_contested_base_is_a_choice(tables):
    streams = read_synctables(*tables)
    assert [hd_time_ms(streams, 3, base) for base in (0, 1, 2)] == pytest.approx(
        [53000.0 + k * 33.367 for k in (3, 4, 5)]
    )
    assert hd_time_ms(streams, 3) == hd_time_ms(streams, 3, 1)
    with pytest.raises(DataError, match="base"):
        hd_time_ms(streams, 3, 3)
    with pytest.raises(DataError, match="40 entries"):
        hd_time_ms(streams, 39)


def test_kinect_frames_of_an_hd_frame_and_holes(tables):
    streams = read_synctables(*tables)
    found = match_kinects(streams, 10, 0)["KINECTNODE1"]
    assert (found.color, found.depth) == (110, 210)
    hole = match_kinects(streams, 7, 0)["KINECTNODE1"]
    assert hole.color == 107 and hole.depth is None
    hole = match_kinects(streams, 9, 0)["KINECTNODE1"]
    assert hole.depth == 209 and hole.color is None
    stamps, numbers = streams["color/KINECTNODE1"].stamps()
    assert len(stamps) == 39 and 109 not in numbers and stamps[0] == 53_010_250_000


def test_what_is_no_table_is_told(tmp_path):
    bad = tmp_path / "x.json"
    for document, match in (
        ({}, "no sync table"),
        ({"hd": {"univ_time": ["a"]}}, "hd.univ_time"),
        ([1], "not a sync table"),
        ({"hd": {"univ_time": [1.0], "index": [1, 2]}}, "2 indices"),
        ({"hd": 3}, "hd.univ_time"),
    ):
        bad.write_text(json.dumps(document))
        with pytest.raises(DataError, match=match):
            read_synctables(bad)


FOLDER = Path(os.environ.get("PANOPTIC_LIKE_TABLES", "nowhere"))


@pytest.mark.skipif(not FOLDER.is_dir(), reason="PANOPTIC_LIKE_TABLES names no folder with larger tables")
def test_larger_tables_against_their_truth():
    streams = read_synctables(FOLDER / "synctables_like.json", FOLDER / "ksynctables_like.json")
    truth = json.loads((FOLDER / "truth.json").read_text())
    for node, values in truth.items():
        times = streams[f"depth/{node}"].times_ms
        there = np.isfinite(times)
        slope = np.polyfit(np.arange(len(times))[there], times[there], 1)[0]
        assert slope == pytest.approx(values["period_ms"], abs=2e-3)
        assert set(values["lost_depth"]) <= set(np.flatnonzero(~there).tolist())
    near = [match_kinects(streams, k) for k in range(5, 300)]
    assert sum(m["KINECTNODE1"].depth is not None for m in near) > 250
