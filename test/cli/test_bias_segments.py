"""`panoptic bias measure --segments` on a simulated capture, and its file in `panoptic kinematics`."""

import numpy as np
import pytest
from bodies import MODEL

from panoptic_ros.cli.main import main
from panoptic_ros.domain.subjects import BodyState
from panoptic_ros.geometry.chain import place_all
from panoptic_ros.geometry.rotations import rotations_of
from panoptic_ros.io.body_files import write_bodies
from panoptic_ros.io.files import write_json
from panoptic_ros.io.joint_offsets import read_joint_offsets
from panoptic_ros.io.recorded_motions import read_clips

NAMES = tuple(MODEL.keypoints)
SHIFT = {"lHip": np.array([0.03, -0.01, 0.0]), "rHip": np.array([0.03, 0.01, 0.0])}


@pytest.fixture
def files(tmp_path):
    """Bodies, true joints, and joints of a detector whose hips are off in the frames of the thighs."""
    states, rows = [], {"truth": [], "seen": []}
    body, clip = MODEL.body(1.7), read_clips()["02_05"]
    for i, vectors in enumerate(clip.vectors[:24]):
        people = {"truth": [], "seen": []}
        for k in (3, 4):
            turns = rotations_of(np.ascontiguousarray(vectors))
            places, frames = place_all(body.chain, np.array([[0.02 * i, 2.0 * k, 1.0]]), turns[None])
            states.append(BodyState(i * 40_000_000, k, places[0], frames[0]))
            for key in people:
                sites = [(*body.keypoints[n], SHIFT.get(n, 0.0) if key == "seen" else 0.0) for n in NAMES]
                joints = [places[0, s] + frames[0, s] @ (offset + off) for s, offset, off in sites]
                people[key].append({"id": k, "joints": np.array(joints).tolist()})
        for key, found in people.items():
            rows[key].append({"index": i, "stamp_ns": i * 40_000_000, "skeletons": found})
    for key, frames in rows.items():
        document = {"format": "panoptic-skeletons-1", "joint_names": NAMES, "frames": frames}
        write_json(tmp_path / f"{key}.json", document)
    write_bodies(tmp_path / "kinematics.json.gz", MODEL, states)
    return tmp_path


def measure(files, truth, *more):
    arguments = [str(files / truth), str(files / "seen.json"), "--out", str(files / "o.yaml"), *more]
    return main(["bias", "measure", "--segments", *arguments])


@pytest.mark.parametrize("truth", ["truth.json", "kinematics.json.gz"])
def test_offsets_are_measured_written_and_judged(files, capsys, truth):
    assert measure(files, truth, "--detector", "made") == 0
    printed = capsys.readouterr().out.splitlines()
    assert len(printed) == 4 and printed[1].split()[0] == "3"
    found = read_joint_offsets(files / "o.yaml", MODEL).offsets
    assert found["lHip"].frame == "lThigh" and np.allclose(found["lHip"].offset, SHIFT["lHip"], atol=2e-3)
    assert np.allclose(found["rKnee"].offset, 0.0, atol=2e-3)


def test_mistakes_are_told_in_one_line(files, capsys):
    measured = files / "o.yaml"
    for arguments, told in (
        (("truth.json", "--leave-out", "9"), "3, 4"),
        (("truth.json", "--bodies", str(files / "none.gz")), "--bodies"),
        (("kinematics.json.gz", "--bodies", str(files / "kinematics.json.gz")), "leave out --bodies"),
        (("truth.json", "--leave-out", "3", "--leave-out", "4"), "not left out"),
        (("seen.yaml",), "seen.yaml"),
    ):
        assert measure(files, *arguments) == 2
        error = capsys.readouterr().err.strip().splitlines()
        assert len(error) == 1 and told in error[0]
    assert main(["bias", "measure", "a", "b", "--out", "c", "--bodies", "d"]) == 2
    assert not measured.exists()
