"""The constructors of stages make all kernels ready: whatever a live stage meets, nothing compiles."""
import json
import subprocess
import sys
from pathlib import Path

import live_situations
import pytest

import panoptic_ros
from panoptic_ros.graph.nodes import FUSION, NODES

SMALL = {"method": "exact", "volume": [-1, -1, 0, 1, 1, 2], "voxel": 0.1}  # few voxels: kernels are the same


def late(program: str, *arguments: object) -> str:
    """Kernels that were not ready, in a fresh process."""
    done = subprocess.run(
        [sys.executable, live_situations.__file__, program, json.dumps(arguments)],
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout.strip()


@pytest.mark.parametrize(
    ("cameras", "settings", "skeleton"),
    [
        (5, {}, ""),
        (2, {}, ""),
        (31, {}, ""),
        (5, {"sync": {"resampling": "interpolate", "rate_hz": 50.0}, "refinement": {"lag": 0.0}}, ""),
        (5, {"voting": {"without_maps": True}}, ""),
        (4, {"assembly": {"method": "dynamic_programming"}, "voting": SMALL}, ""),
        (3, {"voting": {**SMALL, "parts": True}}, ""),
        (5, {"voting": {"method": "off"}, "refinement": {"bone_sigma": 0.0}}, ""),
        (5, {"voting": {"explain_away": False}, "association": {"temporal_guidance": False}}, ""),
        (4, {"assembly": {"learn_noise": False}, "association": {"compensate_stamps": False}}, "coco17"),
    ],
)
def test_from_2d_people_to_skeletons(cameras, settings, skeleton):
    assert late("chain", cameras, settings, skeleton) == "[]"


def test_offsets():
    assert late("offsets") == "[]"


def test_timecode_and_clocks():
    assert late("timecode") == "[]"


def test_motion_of_the_surface():
    assert late("surface") == "[]"


def test_bodies():
    assert late("bodies") == "[]"


def test_detection():
    assert late("detection") == "[]"


def test_no_other_stage_compiles():
    root = Path(panoptic_ros.__file__).parent
    tested = {"sync", *FUSION, "offsets", "timecode", "clocks", "flow", "patches", "kinematics", "detection"}
    for name in set(NODES) - tested:
        assert not any("njit" in path.read_text() for path in (root / name).rglob("*.py")), name
