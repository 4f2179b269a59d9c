"""Stages and configurations by name."""

import pytest

from panoptic_ros.errors import ConfigError
from panoptic_ros.graph.build import configure, merged, parse_setting, switched_on
from panoptic_ros.graph.counters import StageStatistics
from panoptic_ros.graph.flow import make_flow
from panoptic_ros.graph.nodes import NODES
from panoptic_ros.graph.topics import TOPICS


def test_settings():
    assert parse_setting("sync.window_s = 0.01") == ("sync", "window_s", 0.01)
    assert parse_setting("detection.providers=a,b") == ("detection", "providers", ("a", "b"))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("sync", "write stage.parameter=value"),
        ("sync=1", "write stage.parameter=value"),
        ("sink.window_s=1", "no stage 'sink'"),
        ("sync.width=1", "'width'"),
        ("sync.window_s=wide", "'wide'"),
    ],
)
def test_wrong_settings(text, told):
    with pytest.raises(ConfigError, match=told):
        parse_setting(text)


def test_configurations_of_all_stages():
    configs = configure({"sync": {"window_s": 0.5}})
    assert set(configs) == set(NODES) and configs["sync"].window_s == 0.5
    with pytest.raises(ConfigError, match="no stage"):
        configure({"sink": {}})


def test_settings_are_merged_parameter_by_parameter_and_stay_as_they_were():
    first = {"sync": {"rate_hz": 25.0, "phase_s": 0.1}}
    second = {"sync": {"rate_hz": 30.0}, "voting": {"voxel": 0.1}}
    assert merged(first, second) == {"sync": {"rate_hz": 30.0, "phase_s": 0.1}, "voting": {"voxel": 0.1}}
    assert merged(second, first)["sync"] == {"rate_hz": 25.0, "phase_s": 0.1}
    assert first == {"sync": {"rate_hz": 25.0, "phase_s": 0.1}} and merged() == {}


def test_every_topic_of_a_node_is_in_the_table():
    for spec in NODES.values():
        assert set(spec.outputs) <= set(TOPICS) and {port.topic for port in spec.inputs} <= set(TOPICS)


def test_queues_of_a_replay_are_longer_than_what_may_be_under_way():
    flow = make_flow("replay", 30)
    assert flow.depth > flow.window == 30 and flow.image_depth > flow.image_window
    assert flow.keeps_for_late and flow.queue_limit is None
    with pytest.raises(ConfigError, match="'slow'"):
        make_flow("slow")


def test_statistics_as_text():
    statistics = StageStatistics()
    assert statistics.values()["step_p50_ms"] == "nan"
    for duration in (1_000_000, 2_000_000, 3_000_000):
        statistics.add_duration(duration)
    statistics.dropped["queue_full"] += 2
    statistics.notices["sync.late_frame"] += 1
    values = statistics.values()
    assert values["step_p50_ms"] == "2.000" and values["dropped.queue_full"] == "2"
    assert values["notice.sync.late_frame"] == "1"


def test_what_two_stages_must_agree_in_is_given_to_both():
    configs = configure({"sync": {"delays_ms": ["a=3"]}})
    assert configs["offsets"].delays_ms == configs["sync"].delays_ms == ("a=3",)
    configs = configure({"sync": {"delays_ms": ["a=3"]}, "offsets": {"delays_ms": ["a=4"]}})
    assert configs["offsets"].delays_ms == ("a=4",)


def test_dynamic_programming_switches_on_what_it_reads_unless_it_is_given():
    assert not configure({"assembly": {"method": "consensus"}})["voting"].parts
    paper = {"method": "dynamic_programming"}
    voting = configure({"assembly": paper})["voting"]
    assert voting.parts and voting.without_maps
    voting = configure({"assembly": paper, "voting": {"parts": False}})["voting"]
    assert voting.without_maps and not voting.parts


def test_patches_that_are_off_start_nothing():
    names = ("detection", "flow", "patches", "refinement")
    assert switched_on(names, configure({})) == ("detection", "refinement")
    assert switched_on(names, configure({"patches": {"active": True}})) == names
