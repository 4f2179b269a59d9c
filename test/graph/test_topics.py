"""Names of cameras as ROS allows them."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from panoptic_ros.errors import CalibrationError
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.topics import ALWAYS_SHOWN, ASKED_FOR, TOPICS, check_names, ros_name


@pytest.mark.parametrize(
    ("name", "plain"),
    [
        ("cam01", "cam01"),
        ("00_12", "camera_00_12"),
        ("left cam", "left_cam"),
        ("a-b/c.d", "a_b_c_d"),
        ("3", "camera_3"),
    ],
)
def test_ros_name(name, plain):
    assert ros_name(name) == plain
    assert TOPICS["detections"].of(name) == f"{plain}/detections"


def test_topics_of_the_graph_have_no_owner():
    assert TOPICS["skeletons"].of() == "skeletons"


@given(st.text(min_size=1, max_size=60))
def test_every_name_becomes_a_valid_one_that_stays(name):
    plain = ros_name(name)
    assert re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", plain)
    assert ros_name(plain) == plain


def test_cameras_that_would_share_topics_are_refused():
    check_names(["a", "a b", "b"])
    with pytest.raises(CalibrationError, match="'a-b' and 'a_b'"):
        check_names(["a-b", "c", "a_b"])


def test_name_too_long_for_a_topic():
    with pytest.raises(CalibrationError, match="300 characters"):
        check_names(["b", "a" * 300])


def test_what_a_run_keeps_depends_on_nothing_or_on_a_switch_of_a_stage():
    configs = configure({})
    for row in TOPICS.values():
        if row.kept not in ("", "always"):
            stage, parameter = row.kept.split(".")
            assert isinstance(getattr(configs[stage], parameter), bool), row.key


def test_the_viewer_shows_only_topics_of_cameras_and_of_the_graph():
    assert {TOPICS[key].scope for key in (*ALWAYS_SHOWN, *ASKED_FOR)} == {"camera", "graph"}
    assert not set(ALWAYS_SHOWN) & set(ASKED_FOR)
