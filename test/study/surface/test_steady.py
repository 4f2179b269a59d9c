"""The study of captures without truth, from the command line and on tracks that are known."""

from types import SimpleNamespace

import captures
import numpy as np
import patch_scene
import pytest

from panoptic_ros.cli.main import main
from panoptic_ros.domain import TrackedPoseSet
from panoptic_ros.evaluation import SkeletonSequence
from panoptic_ros.graph.build import configure
from panoptic_ros.study.study import table
from panoptic_ros.study.surface.refine_ways import RefinementInputs
from panoptic_ros.study.surface.steady import SteadinessStudy, steady_rows, tracks_of, with_changes


def played(items):
    """A run whose raw skeletons and 2D tracks are these."""
    configs = configure({"patches": {"active": True}})
    plan = SimpleNamespace(rig=captures.RIG, skeleton=captures.SKELETON, configs=configs)
    raw = [item for item in items if isinstance(item, TrackedPoseSet)]
    others = [item for item in items if not isinstance(item, TrackedPoseSet)]
    return RefinementInputs(
        plan, captures.RIG, SkeletonSequence(captures.SKELETON.joint_names, ()), raw, others
    )


def test_a_capture_is_asked_for(tmp_path, capsys):
    assert main(["study", "steady"]) == 2
    assert "--capture" in capsys.readouterr().err
    assert main(["study", "steady", "--capture", str(tmp_path)]) == 2
    assert str(tmp_path) in capsys.readouterr().err


def test_patches_steady_somebody_who_is_measured_with_noise():
    joints, items = captures.people(0.0)[1], []
    for index in range(60):
        items += patch_scene.tracks(index, joints, lambda points: points, noise_px=0.1) if index else []
        items.append(patch_scene.skeletons(index, joints, noise=0.01))
    rows = steady_rows(played(items))
    assert [(row["person"], row["lag_s"], row["method"]) for row in rows] == [
        (7, lag, method) for lag in (0.0, 0.12) for method in ("smoother", "smoother, patches")
    ]
    for without, with_patches in (rows[:2], rows[2:]):
        assert without["instants"] == with_patches["instants"] == 60
        assert with_patches["noise"] < 0.7 * without["noise"]
    lines = table(with_changes(rows), SteadinessStudy.columns)
    change = rows[1]["noise"] / rows[0]["noise"] - 1.0
    assert len(lines) == 5 and f"{change:+.0%}" in lines[2] and "%" not in lines[1]


def test_tracks_hold_everybody_from_first_to_last_with_gaps():
    joints = captures.people(0.0)[1]
    items = [patch_scene.skeletons(k, joints, missing=(3,) if k == 2 else ()) for k in (0, 1, 2, 4)]
    stamps, places = tracks_of(items)[7]
    assert stamps.tolist() == [item.stamp_ns for item in items] and places.shape == (4, *joints.shape)
    assert np.isnan(places[2, 3]).all() and places[3] == pytest.approx(joints)
