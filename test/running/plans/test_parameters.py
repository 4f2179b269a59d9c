"""Parameters from texts and from files."""

import pytest

from panoptic_ros.errors import ConfigError
from panoptic_ros.io.resources import share_folder
from panoptic_ros.running.plans.parameters import live_parameters, read_parameters, with_defaults


def test_settings_go_before_the_file_and_the_file_before_defaults(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("sync: {window_s: 0.02, queue_limit: 9}\n")
    given = read_parameters(path, ["sync.window_s=0.03"])
    sync = with_defaults(given, {"sync": {"window_s": 0.04, "queue_limit": 8, "minimum_views": 2}})["sync"]
    assert (sync.window_s, sync.queue_limit, sync.minimum_views) == (0.03, 9, 2)


def test_ros_parameter_files_are_taken_as_they_are():
    for path in sorted((share_folder() / "config").glob("*.yaml")):
        assert path.stem in read_parameters(path, [])


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("sync", "must hold"),
        ("sync: 1", "must hold"),
        ("sync: {wide: 1}", "wide"),
        ("sync: {window_s: a}", "'a'"),
        ("sink: {}", "no stage 'sink'"),
        ("sync: {ros__parameters: {wide: 1}}", "wide"),
    ],
)
def test_wrong_files(tmp_path, text, told):
    (tmp_path / "mine.yaml").write_text(text)
    with pytest.raises(ConfigError, match=told):
        read_parameters(tmp_path / "mine.yaml", [])


def test_live_runs_wait_half_a_second_for_a_camera_and_one_set_at_most():
    for rate in (5.0, 30.0, 120.0):
        found = live_parameters(rate)
        assert found["sync"]["deadline_s"] == max(0.5, 3.0 / rate)
        assert found["refinement"]["lag"] < 1.0 / rate
