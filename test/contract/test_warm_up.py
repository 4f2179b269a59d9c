"""The constructors of stages make all kernels ready: whatever a live stage meets, nothing compiles."""

import json
import subprocess
import sys
from pathlib import Path

import live_situations

import panoptic_ros
from panoptic_ros.graph.nodes import FUSION, NODES

SMALL = {"method": "exact", "volume": [-1, -1, 0, 1, 1, 2], "voxel": 0.1}  # few voxels: kernels are the same


CHAINS = [
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
]  # cameras, settings, skeleton
OTHERS = ("offsets", "continuous", "timecode", "surface", "health", "bodies", "detection")


def test_nothing_compiles_in_live_stages():
    cases = [*(("chain", chain) for chain in CHAINS), *((name, ()) for name in OTHERS)]
    done = subprocess.run(
        [sys.executable, live_situations.__file__, json.dumps(cases)], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr[-3000:]
    late = json.loads(done.stdout)
    assert len(late) == len(cases)
    assert [(case, kernels) for case, kernels in zip(cases, late) if kernels] == []


def test_no_other_stage_compiles():
    root = Path(panoptic_ros.__file__).parent
    tested = {"sync", *FUSION, "offsets", "timecode", "clocks", "flow", "patches", "kinematics", "detection"}
    tested |= {"continuous", "health"}
    for name in set(NODES) - tested:
        assert not any("njit" in path.read_text() for path in (root / name).rglob("*.py")), name
