"""What every stage takes and which joints are far off, on cases whose answer is known."""

import json
from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.cli.main import main
from panoptic_ros.evaluation import SkeletonSequence
from panoptic_ros.study.fusion import solve
from panoptic_ros.study.names import parsed
from panoptic_ros.study.world import simulated_world

REQUEST = {"scene": "clean-4p5v", "seed": 3, "frames": 12}


def test_every_stage_has_its_time_and_no_joint_of_easy_people_is_far_off():
    row = solve.measure_case(REQUEST)
    times = [row[f"{stage}_ms"] for stage in solve.STAGES]
    assert min(times) > 0.0 and max(times) < row["whole_ms"] and (row["frames"], row["views"]) == (12, 5)
    assert row["far"] == 0 < row["joints"] <= 12 * 4 * 19


def test_joints_that_are_far_off_are_counted(monkeypatch):
    """The truth of one joint of one person is moved by 15 cm in five frames."""
    world = simulated_world("clean-4p5v", 3, 12)

    def moved(frame, k):
        positions = frame.positions.copy()
        positions[0, 4] += [0.15, 0.0, 0.0] if 4 <= k < 9 else 0.0
        return replace(frame, positions=positions)

    truth = world.truth
    frames = tuple(moved(frame, k) for k, frame in enumerate(truth.frames))
    far = replace(world, truth=SkeletonSequence(truth.joint_names, frames))
    monkeypatch.setattr(solve, "simulated_world", lambda *_: far)
    assert solve.measure_case(REQUEST)["far"] == 5


def test_the_table_names_all_cases_and_sums_up(capsys):
    arguments = ["study", "solve", "--scenes", "clean-4p5v", "--seeds", "3:4", "--frames", "12", "--json"]
    assert main(arguments) == 0
    result = json.loads(capsys.readouterr().out)
    text = list(parsed("solve", []).lines(result))
    assert text[1].startswith("clean-4p5v 3") and len(text) == 3
    joints = result["rows"][0]["joints"]
    assert f"0 of {joints} joints" in text[-1] and np.isfinite(result["rows"][0]["whole_ms"])


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--scenes", "rendered-3p8v"], "is rendered"),
        (["--scenes", ""], "nothing to solve"),
        (["--seeds", "7:"], "FROM:TO"),
    ],
)
def test_what_cannot_be_solved_is_told(arguments, told, capsys):
    assert main(["study", "solve", *arguments]) == 2
    assert told in capsys.readouterr().err
