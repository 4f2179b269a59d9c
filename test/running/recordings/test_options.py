"""What the disk has room for is told before a recording begins."""

from __future__ import annotations

import shutil

import pytest

from panoptic_ros.errors import EnvironmentProblem
from panoptic_ros.io.bag_split import GB
from panoptic_ros.running.recordings import options
from panoptic_ros.running.recordings.options import RecordOptions

RATES = {"/a/image": 3e6, "/a/detections": 1e6}  # bytes/s


@pytest.fixture(autouse=True)
def eleven_gb_free(monkeypatch):
    disk = shutil.disk_usage("/")._replace(free=round(11 * GB))
    monkeypatch.setattr(options.shutil, "disk_usage", lambda place: disk)


@pytest.mark.parametrize(
    ("budget_gb", "gb", "hours"),
    [(0.0, 10.0, 10 * GB / 4e6 / 3600), (2.0, 2.0, 2 * GB / 4e6 / 3600), (50.0, 10.0, 10 * GB / 4e6 / 3600)],
)
def test_room_is_what_is_free_or_the_budget(tmp_path, budget_gb, gb, hours):
    line = options.told_room(tmp_path / "not" / "yet", RATES, RecordOptions(budget_gb=budget_gb))
    assert line.startswith("4.00 MB/s on 2 topics")
    assert "most of it /a/image" in line
    assert line.endswith(f"room for {gb:.1f} GB, {hours:.1f} h")


def test_a_time_that_does_not_fit_is_refused_with_what_it_needs(tmp_path):
    fits = 10 * GB / 4e6
    options.told_room(tmp_path, RATES, RecordOptions(duration_s=fits - 1))
    with pytest.raises(EnvironmentProblem, match=r"need 10\.00 GB.* room for 10\.00 GB"):
        options.told_room(tmp_path, RATES, RecordOptions(duration_s=fits + 1))


def test_topics_on_which_nothing_comes_tell_no_rate(tmp_path):
    assert options.told_room(tmp_path, {}, RecordOptions()) == (
        "no messages on the topics yet; room for 10.0 GB"
    )
