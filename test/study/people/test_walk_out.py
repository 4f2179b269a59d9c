"""People walk out of the cameras: who sees them when."""

import numpy as np
from study_runs import run_whole

from panoptic_ros.cli.main import main
from panoptic_ros.graph.build import configure
from panoptic_ros.simulation import simulate
from panoptic_ros.simulation.scenes import scene
from panoptic_ros.simulation.skeleton import SKELETON
from panoptic_ros.stage import StageContext
from panoptic_ros.study.names import parsed
from panoptic_ros.study.people.walk_out import (
    EVERY,
    ONE,
    TWO,
    WalkOutTake,
    simulated,
    thinned,
)


def showing(item):
    """The cameras that show anybody."""
    return {view.camera for view in item.views if len(view.points)}


def test_a_capture_is_left_with_two_cameras_and_then_with_one_of_them():
    what = simulate(scene("clean-4p5v"), 5, 9)
    sets = list(what.detection_sets())
    whole = simulated(what, {})
    take = WalkOutTake(StageContext(what.rig, SKELETON), configure({}), sets, {}, whole.truth)
    drawn = set()
    for seed in range(4):
        found = thinned(take, seed)
        assert [found.phases[item.stamp_ns] for item in sets] == [EVERY] * 3 + [TWO] * 3 + [ONE] * 3
        assert [len(showing(item)) for item in found.sets] == [5] * 3 + [2] * 3 + [1] * 3
        assert len({frozenset(showing(item)) for item in found.sets[3:6]}) == 1
        assert showing(found.sets[-1]) < showing(found.sets[3])
        drawn.add(frozenset(showing(found.sets[3])))
        again = thinned(take, seed)
        assert [showing(item) for item in again.sets] == [showing(item) for item in found.sets]
    assert len(drawn) > 1
    assert [showing(item) for item in take.sets] == [showing(item) for item in sets]  # nothing changed


def test_phases_of_a_simulated_take_begin_when_its_views_end():
    what = simulate(scene("walk-out-3p8v"), 2)
    take, seconds = simulated(what, {}), what.schedule.ticks
    phases = np.array([take.phases[item.stamp_ns] for item in take.sets])
    assert (phases[seconds < 0.99] == "").all() and (phases[seconds > 6.01] == "").all()
    assert (phases[(seconds > 1.01) & (seconds < 2.99)] == EVERY).all()
    assert (phases[(seconds > 3.01) & (seconds < 4.49)] == TWO).all()
    assert (phases[(seconds > 4.51) & (seconds < 5.99)] == ONE).all()
    assert set(take.people) == {0} and len(take.truth.frames) == len(take.sets)


def test_somebody_is_held_while_views_see_the_upper_half():
    study = parsed("walkout", ["--seeds", "7"])
    result = run_whole(study)
    rows = {row["phase"]: row for row in result["rows"] if row["joints"] == "all"}
    assert rows[EVERY]["given"] == 1.0 and rows[EVERY]["mean_mm"] < 5.0
    assert rows[TWO]["mean_mm"] < 40.0 and rows[ONE]["mean_mm"] < 150.0 and rows[ONE]["given"] > 0.4
    assert {row["of"] for row in result["rows"]} == {"skeletons"}
    lines = list(study.lines(result))
    assert "simulated walk-out-3p8v" in lines[0] and "seeds 7" in lines[0]
    assert sum(line.startswith(ONE) for line in lines) == sum(r["phase"] == ONE for r in result["rows"])


def test_bodies_of_everybody_are_told_too_if_they_are_asked_for():
    study = parsed("walkout", ["--seeds", "7", "--set", "kinematics.everybody=true"])
    result = run_whole(study)
    bodies = [row for row in result["rows"] if row["of"] == "bodies"]
    rows = {row["phase"]: row for row in bodies if row["joints"] == "all"}
    assert rows[EVERY]["mean_mm"] < 20.0 and rows[ONE]["mean_mm"] < 200.0
    lines = list(study.lines(result))
    assert sum(line.startswith(ONE) for line in lines) == sum(r["phase"] == ONE for r in result["rows"])


def test_what_is_asked_for_wrongly_is_told_in_a_line(tmp_path, capsys):
    assert main(["study", "walkout", "--capture", str(tmp_path)]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
