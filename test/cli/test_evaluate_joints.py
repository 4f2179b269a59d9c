"""`panoptic evaluate --joints`, and results whose joints are spelt otherwise."""

import json

import numpy as np
import pytest

from panoptic_ros.cli.main import main
from panoptic_ros.io.files import write_json

TRUTH = ["Neck", "lHip", "rHip", "lKnee", "rKnee", "lWrist"]
RESULT = ["left_wrist", "left_hip", "right_hip", "left_knee", "right_knee", "neck"]
BODY = np.array([[0, 0, 1.4], [0, 0.1, 0.9], [0, -0.1, 0.9], [0, 0.1, 0.5], [0, -0.1, 0.5], [0.2, 0.4, 1.0]])


def write(path, names, joints):
    skeletons = [{"id": 0, "joints": joints.tolist()}]
    frames = [{"index": i, "stamp_ns": i * 40_000_000, "skeletons": skeletons} for i in range(4)]
    write_json(path, {"format": "panoptic-skeletons-1", "joint_names": names, "frames": frames})
    return str(path)


@pytest.fixture
def files(tmp_path):
    wrong = BODY + [0.0, 0.0, 0.02]
    wrong[0] += [0.0, 0.0, 0.20]  # the neck alone is far off
    return write(tmp_path / "truth.json", TRUTH, BODY), write(
        tmp_path / "result.json", RESULT, wrong[[5, 1, 2, 3, 4, 0]]
    )


def scores(files, capsys, *more):
    assert main(["evaluate", *files, "--json", *more]) == 0
    return json.loads(capsys.readouterr().out)


def test_joints_are_the_same_however_they_are_spelt(files, capsys):
    found = scores(files, capsys)
    assert found["mpjpe_mm"] == pytest.approx((5 * 20 + 220) / 6)
    assert found["median_by_joint_mm"]["Neck"] == pytest.approx(220.0)


@pytest.mark.parametrize("which", ["coco17", "left_hip,rHip,lKnee,rKnee,lWrist"])
def test_a_skeleton_or_names_leave_out_the_others(files, capsys, which):
    found = scores(files, capsys, "--joints", which)
    assert found["mpjpe_mm"] == pytest.approx(20.0)
    assert set(found["mpjpe_by_joint_mm"]) == set(TRUTH) - {"Neck"}


@pytest.mark.parametrize(
    ("which", "named"), [("lHip,tail", "tail"), ("lHip,rHip", "2 of the truth's"), ("no.yaml", "no.yaml")]
)
def test_mistakes_are_told_in_one_line(files, capsys, which, named):
    assert main(["evaluate", *files, "--joints", which]) == 2
    told = capsys.readouterr().err.strip()
    assert named in told and len(told.splitlines()) == 1


def test_a_joint_that_stands_twice_under_two_names_is_refused(files, tmp_path, capsys):
    twice = write(tmp_path / "twice.json", ["lHip", "left_hip", "rHip", "lKnee", "rKnee", "lWrist"], BODY)
    assert main(["evaluate", files[0], twice]) == 2
    assert "lHip" in capsys.readouterr().err
