"""The bench runs from end to end, its baselines solve easy scenes, and its tables are whole."""

import json

import numpy as np
import pytest
from study_runs import in_this_process, run_whole

from panoptic_ros.cli.main import main
from panoptic_ros.errors import UsageError
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.pipeline import records_of
from panoptic_ros.stage import StageContext
from panoptic_ros.study.names import parsed
from panoptic_ros.study.stage1 import stage1
from panoptic_ros.study.stage1.any_skeleton import in_joints_of
from panoptic_ros.study.stage1.baselines import GreedyBaseline
from panoptic_ros.study.stage1.chain import WatchedVoting
from panoptic_ros.study.stage1.layouts import Spread, layout_of, make_world
from panoptic_ros.voting.config import VotingConfig


def test_a_case_measures_every_method_and_dense_voting_agrees_with_exact(monkeypatch):
    few = "--people 2 --views 4 --many-views 0 --skeletons panoptic15 --frames 3 --budget 0.01 --seeds 1"
    study = parsed("stage1", few.split())
    in_this_process(monkeypatch, study)
    measured = run_whole(study)["rows"]
    assert {row["kind"] for row in measured} == {"grid", "joints"}
    found = [row for row in measured if row["kind"] == "grid"]
    rows = {(row["step"], row["method"]): row for row in found}
    assert {step for step, _ in rows} == {
        "assembly",
        "tracking",
        "refinement",
        "whole stage",
        "voting",
        "2D people to ids",
        "triangulation",
    }
    assert rows["voting", "dense (baseline)"]["equal_to_exact"] is True
    for (_, method), row in rows.items():
        assert row.get("calls", 0) >= 1 or method.startswith("aniposelib")
    whole = rows["whole stage", "voting and assembly, from maps"]
    assert whole["person_recall"] == 1.0 and whole["mpjpe_mm"] < 40.0
    own = [row | {"case": "2 people"} for row in found]
    result = json.loads(json.dumps({"rows": own, "growth": []}))
    text = "\n".join(parsed("stage1", []).lines(result))
    assert "2 people (maps 128x72)" in text and "exact voting gives what dense voting gives: yes" in text


def test_greedy_baseline_finds_the_people_of_an_easy_scene():
    world = make_world(people=2, views=8, frames=4, seed=0, maps=False)
    baseline = GreedyBaseline(world.rig)
    for item, truth in zip(world.sets, world.truth.frames):
        ids, joints = baseline.step(item)
        gaps = np.nanmean(np.linalg.norm(joints[:, None] - truth.positions[None], axis=-1), axis=-1)
        assert gaps.min(axis=0).max() < 0.05 and len(set(ids.tolist())) == len(ids)
    assert max(ids) < 4


def test_given_identities_are_those_of_the_truth():
    world = make_world(people=3, views=5, frames=1, seed=3, maps=False)
    pixels, scores = world.given[0]
    for c, camera in enumerate(world.rig.cameras):
        expected, _ = camera.project(world.truth.frames[0].positions)
        misses = np.linalg.norm(pixels[:, :, c] - expected, axis=-1)
        assert np.nanmedian(misses) < 5.0 and (np.isfinite(misses) == (scores[..., c] > 0)).all()


def test_rigs_have_the_views_that_were_asked_for():
    for views in (2, 3, 5, 31, 60):
        assert len(layout_of(views, 4).rig.build(np.random.default_rng(0))) == views
    few, many = (set(Spread(n).build(np.random.default_rng(0)).names) for n in (50, 70))
    assert few < many
    with pytest.raises(UsageError, match="481 views"):
        layout_of(481, 1)


def test_growth_compares_like_with_like():
    rows = [
        {"kind": "grid", "people": p, "views": v, "joints": 19}
        | {"step": "s", "method": "m", "calls": 9, "cpu_ms_median": float(p * v**2)}
        for p in (1, 4)
        for v in (3, 5, 10)
    ]
    found = {row["in"]: row for row in stage1.growth(rows)}
    assert found["views"]["exponent"] == pytest.approx(2.0) and found["views"]["at"] == "4 people"
    assert found["people"]["exponent"] == pytest.approx(1.0) and found["people"]["at"] == "5 views"


def test_mistakes_on_the_command_line_are_told(capsys):
    assert main(["study", "stage1", "--views", "three"]) == 2
    assert "'three' is not a list of whole numbers" in capsys.readouterr().err
    assert main(["study", "stage1", "--frames", "1"]) == 2


def test_requests_of_a_recording_keep_its_options():
    (case,) = parsed("stage1", ["--bag", "bag", "--cameras", "a,b", "--skeleton", "coco17"]).cases()
    assert case.request["skeleton"] == "coco17" and case.request["cameras"] == ["a", "b"]


def test_a_world_in_the_joints_of_another_skeleton():
    world = make_world(people=2, views=3, frames=2, seed=0, maps=True)
    fewer = in_joints_of(world, "coco17")
    names, wrist = world.skeleton.joint_names, fewer.skeleton.joint("left_wrist")
    for item, old in zip(fewer.sets, world.sets):
        for view, full in zip(item.views, old.views):
            assert view.points.shape[1] == len(fewer.skeleton) == 17
            old_wrist = names.index("lWrist")
            assert np.array_equal(view.points[:, wrist], full.points[:, old_wrist], equal_nan=True)
            assert np.array_equal(view.maps.dense(17)[wrist], full.maps.dense(len(names))[old_wrist])


def test_what_explaining_away_leaves_can_be_searched_again():
    world = make_world(people=2, views=4, frames=2, seed=1, maps=True)
    context = StageContext(world.rig, world.skeleton)
    watched = WatchedVoting(VotingConfig(), context)
    for item in records_of("associations", world.sets, configure({}), context):
        watched.step(item)
    assert len(watched.left) == 2
    assert all((watched.again(given).joints >= 0).all() for given in watched.left)
