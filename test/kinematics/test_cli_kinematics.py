"""From a simulated capture in files to bodies in a file."""

import gzip
import json
import subprocess
import sys

import numpy as np
import pytest
import yaml

from panoptic_ros.cli.main import main
from panoptic_ros.evaluation.kinematic_scores import score_bodies
from panoptic_ros.io.body_files import read_bodies
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.io.kinematic_files import read_imus, read_subject, write_imus
from panoptic_ros.io.resources import share_folder
from panoptic_ros.simulation.bodies.capture import BodyScene
from panoptic_ros.simulation.bodies.imus import unknown_heading

MODEL = read_body_model()
LEFT_OUT = "left out"


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    from panoptic_ros.running.simulations import bodies as simulated_bodies

    folder = tmp_path_factory.mktemp("body") / "capture"
    scene = simulated_bodies.body_scene
    simulated_bodies.body_scene = lambda name: BodyScene(("02_05",), seconds=5.0, cameras=4)
    try:
        assert main(["simulate", "body-punch", "--seed", "3", "--out", str(folder)]) == 0
    finally:
        simulated_bodies.body_scene = scene
    return folder


def solve(folder, out, *options):
    inputs = ["--rig", folder / "rig.json", "--detections", folder / "detections.json.gz"]
    words = [
        *inputs,
        "--imu",
        folder / "imu.csv.gz",
        "--subject",
        folder / "subject.json",
        "--out",
        out,
        *options,
    ]
    assert main(["kinematics", *map(str, words), "--quiet"]) == 0
    _, truth = read_bodies(folder / "truth.json.gz")
    names, found = read_bodies(out)
    assert names == MODEL.names
    return score_bodies(truth, found, MODEL.parents, 3.0)


@pytest.fixture(scope="module")
def solved(capture, tmp_path_factory):
    """Scores and result of the capture with the default parameters."""
    out = tmp_path_factory.mktemp("solved") / "k.json.gz"
    return solve(capture, out), out


def test_ours_is_better_than_the_papers(capture, solved, tmp_path):
    ours, _ = solved
    papers = solve(capture, tmp_path / "paper.json.gz", "--preset", "malleson-2020")
    assert ours["coverage"] == papers["coverage"] == 1.0
    assert ours["mm"] < 0.8 * papers["mm"] and ours["deg"] < 0.8 * papers["deg"]
    assert ours["acc"] < 0.2 * papers["acc"]


def test_equal_input_gives_equal_bytes(capture, solved, tmp_path):
    solve(capture, tmp_path / "again.json.gz")
    assert (tmp_path / "again.json.gz").read_bytes() == solved[1].read_bytes()


def test_files_are_read_as_they_were_written(capture, tmp_path):
    devices = read_imus(capture / "imu.csv.gz")
    assert len(devices) == 13
    write_imus(tmp_path / "imu.csv", devices)
    again = read_imus(tmp_path / "imu.csv")
    np.testing.assert_array_equal(again["imu05"].quaternions, devices["imu05"].quaternions)
    subject = read_subject(capture / "subject.json", MODEL)
    assert subject.devices[0].mount is not None and len(subject.body.keypoints) == 25


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"height_m": 17.5}, "height_m = 17.5"),
        ({"format": "other"}, "not a panoptic-subject-1"),
        ({"devices": [{"device": "imu01", "segment": "tail"}]}, "no segment 'tail'"),
        ({"segments": {"hips": [0, 0]}}, "is not 3 numbers"),
        ({"segments": {"lShin": [0, 0, -40]}}, "more than half of the stature"),
        ({"id": -3}, "id = -3"),
        ({"id": True}, "id = True"),
        ({"devices": 2 * [{"device": "imu01", "segment": "hips"}]}, "imu01 is listed twice"),
        ({"devices": [{"device": "imu01", "segment": "hips", "mount": [0, 0, 0, 0]}]}, "is not a rotation"),
        ({"inertial_frame": "mars"}, "neither of world, unknown heading"),
        ({"t_pose": {"from_ns": 5, "to_ns": 1}}, "is not before to_ns"),
        ({"t_pose": {"from_ns": 0, "to_ns": 1, "facing": [0, 0, 1]}}, "no direction on the floor"),
        ({"height_m": LEFT_OUT}, "'height_m' is missing"),
        ({"height_m": "tall"}, "a value is wrong: could not convert"),
        ({"keypoints": {"nose": {"offset": [0, 0, 0]}}}, "'segment' is missing"),
    ],
)
def test_wrong_subjects_are_told_in_one_line(capture, tmp_path, change, told, capsys):
    document = json.loads((capture / "subject.json").read_text()) | change
    document = {key: value for key, value in document.items() if value != LEFT_OUT}
    (tmp_path / "subject.json").write_text(json.dumps(document))
    words = [
        "--imu",
        capture / "imu.csv.gz",
        "--subject",
        tmp_path / "subject.json",
        "--out",
        tmp_path / "k.json",
    ]
    assert main(["kinematics", *map(str, words)]) == 2
    error = capsys.readouterr().err
    assert told in error and error.count("\n") == 1


def test_a_broken_gzip_of_imus_is_told(capture, tmp_path, capsys):
    (tmp_path / "imu.csv").write_bytes(b"\x1f\x8b\x00no gzip")
    words = ["--imu", tmp_path / "imu.csv", "--subject", capture / "subject.json", "--out", tmp_path / "k"]
    assert main(["kinematics", *map(str, words)]) == 2
    assert "begins as a gzip file" in capsys.readouterr().err


def test_devices_that_repeat_stamps_or_have_none_are_told_and_somebody_who_never_comes(
    capture, tmp_path, capsys
):
    lines = gzip.decompress((capture / "imu.csv.gz").read_bytes()).decode().splitlines()
    lines = [line for line in lines[:800] if not line.startswith("imu05")]
    lines += [line for line in lines if line.startswith("imu06")]
    (tmp_path / "imu.csv").write_text("\n".join(lines))
    document = json.loads((capture / "subject.json").read_text()) | {"start": [40.0, 40.0, 1.0]}
    document["devices"] = [row for row in document["devices"] if row["device"] != "imu07"]
    document["keypoints"]["rnee"] = document["keypoints"]["rKnee"]
    (tmp_path / "subject.json").write_text(json.dumps(document))
    words = [
        "--rig",
        capture / "rig.json",
        "--detections",
        capture / "detections.json.gz",
        "--imu",
        tmp_path / "imu.csv",
        "--subject",
        tmp_path / "subject.json",
        "--out",
        tmp_path / "k.json",
    ]
    assert main(["kinematics", *map(str, words), "--quiet", "--set", "clocks=false"]) == 0
    told = capsys.readouterr().err
    assert "no samples of imu05; bodies are solved without" in told
    assert "imu06: 62 samples are left out" in told
    assert "no subject wears imu07" in told
    assert "no detector has its keypoints rnee" in told
    assert "subject 0 was not found" in told


def test_imus_alone_go_without_one_that_has_no_samples(capture, tmp_path, capsys):
    lines = gzip.decompress((capture / "imu.csv.gz").read_bytes()).decode().splitlines()
    (tmp_path / "imu.csv").write_text("\n".join(line for line in lines if not line.startswith("imu05")))
    words = ["--imu", tmp_path / "imu.csv", "--subject", capture / "subject.json", "--quiet"]
    assert main(["kinematics", *map(str, words), "--out", str(tmp_path / "k.json")]) == 0
    assert "no samples of imu05; bodies are solved without" in capsys.readouterr().err
    _, found = read_bodies(tmp_path / "k.json")
    _, truth = read_bodies(capture / "truth.json.gz")
    assert score_bodies(truth, found, MODEL.parents, 3.0)["relative_mm"] < 50.0


def test_nothing_to_solve_from_is_told(capture, tmp_path, capsys):
    words = ["--subject", capture / "subject.json", "--out", tmp_path / "k.json"]
    assert main(["kinematics", *map(str, words)]) == 2
    assert "nothing to solve from" in capsys.readouterr().err


def test_help_is_quick_to_import():
    code = "import sys, panoptic_ros.cli.kinematics; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


def test_an_unknown_heading_and_clock_are_found_from_motion(capture, solved, tmp_path, capsys):
    for name in ("rig.json", "detections.json.gz", "truth.json.gz"):
        (tmp_path / name).write_bytes((capture / name).read_bytes())
    devices = read_imus(capture / "imu.csv.gz")
    moved = {name: unknown_heading(series, 2.0).shifted(-60_000_000) for name, series in devices.items()}
    write_imus(tmp_path / "imu.csv.gz", moved)
    document = json.loads((capture / "subject.json").read_text()) | {"inertial_frame": "unknown heading"}
    (tmp_path / "subject.json").write_text(json.dumps(document))
    known, _ = solved
    capsys.readouterr()
    found = solve(tmp_path, tmp_path / "found.json.gz")
    assert found["mm"] < 1.15 * known["mm"] and found["deg"] < known["deg"] + 1.0
    told = capsys.readouterr().err
    assert "heading of the IMUs found from motion" in told and "clock of the IMUs" in told


def test_velocities_angles_and_covariances_are_told(capture, tmp_path):
    solve(capture, tmp_path / "k.json.gz", "--set", "clocks=false")
    _, states = read_bodies(tmp_path / "k.json.gz")
    _, truth = read_bodies(capture / "truth.json.gz")
    assert [state.stamp_ns for state in states] == [state.stamp_ns for state in truth]
    places = np.array([state.places for state in truth])
    true = np.gradient(places, 1 / 60, axis=0)[180:]
    found = np.array([state.velocities for state in states])[180:]
    assert np.linalg.norm(found - true) < 0.4 * np.linalg.norm(true)
    root = np.array([state.frames[0] for state in truth])
    turned = root[181:-1] @ root[179:-3].swapaxes(1, 2)
    spins = 30.0 * np.stack([turned[:, 2, 1], turned[:, 0, 2], turned[:, 1, 0]], axis=-1)
    mine = np.array([state.spins[0] for state in states])[180:-2]
    assert np.median(np.linalg.norm(mine - spins, axis=-1)) < 0.3
    spread = np.array([np.sqrt(np.trace(state.covariances[:, :3, :3], axis1=1, axis2=2)) for state in states])
    apart = np.linalg.norm(np.array([s.places for s in states]) - places, axis=-1)[180:]
    assert 0.3 < np.sqrt((apart**2).mean() / (spread[180:] ** 2).mean()) < 2.0


def test_another_skeleton_is_solved_and_exported(capture, tmp_path, capsys):
    toes = ("lToe", "rToe")
    document = yaml.safe_load((share_folder() / "config" / "bodies" / "segments21.yaml").read_text())
    document["segments"] = {name: row for name, row in document["segments"].items() if name not in toes}
    document["ground"] = [name for name in document["ground"] if name not in toes]
    document["keypoints"] = {n: row for n, row in document["keypoints"].items() if row["segment"] not in toes}
    (tmp_path / "segments19.yaml").write_text(yaml.safe_dump(document, sort_keys=False))
    subject = json.loads((capture / "subject.json").read_text())
    subject["segments"] = {name: row for name, row in subject["segments"].items() if name not in toes}
    subject["keypoints"] = {n: row for n, row in subject["keypoints"].items() if row["segment"] not in toes}
    (tmp_path / "subject.json").write_text(json.dumps(subject))
    words = [
        "--rig",
        capture / "rig.json",
        "--detections",
        capture / "detections.json.gz",
        "--subject",
        tmp_path / "subject.json",
        "--out",
        tmp_path / "k.json.gz",
        "--set",
        f"segments={tmp_path / 'segments19.yaml'}",
    ]
    assert main(["kinematics", *map(str, words), "--quiet"]) == 0
    names, found = read_bodies(tmp_path / "k.json.gz")
    kept = [MODEL.index(name) for name in names]
    true = {state.stamp_ns: state.places[kept] for state in read_bodies(capture / "truth.json.gz")[1]}
    apart = [np.linalg.norm(s.places - true[s.stamp_ns], axis=-1) for s in found if s.stamp_ns in true]
    assert len(names) == 19 and np.mean(apart) < 0.03
    words = ["export", tmp_path / "k.json.gz", "--out", tmp_path / "k.bvh"]
    assert main([*map(str, words)]) == 2
    assert "give --segments" in capsys.readouterr().err
    assert main([*map(str, words), "--segments", str(tmp_path / "segments19.yaml")]) == 0
    assert (tmp_path / "k.bvh").read_text().count("JOINT") == 18


ASSUMED = {
    "t_pose.facing": "facing +x in the t_pose",
    "inertial_frame": 'inertial_frame "world"',
    "segments": "lengths of segments as usual for height_m",
    "position": "at the beginning of its segment",
}


@pytest.mark.parametrize("key", [None, *ASSUMED])
def test_values_that_are_assumed_are_stated_once(capture, tmp_path, capsys, key):
    document = json.loads((capture / "subject.json").read_text())
    document["t_pose"] = {"from_ns": 1_000_000_000, "to_ns": 1_500_000_000, "facing": [1, 0, 0]}
    document["devices"][0].pop("mount", None)
    if key == "t_pose.facing":
        del document["t_pose"]["facing"]
    elif key == "position":
        del document["devices"][1]["position"]
    elif key is not None:
        del document[key]
    path = tmp_path / "subject.json"
    path.write_text(json.dumps(document))
    lines = read_subject(path, MODEL).told()
    assert len(lines) == (key is not None)
    if key is not None:
        assert lines[0].startswith("subject 0: assumed, as its file does not state it: ")
        assert ASSUMED[key] in lines[0]
    if key == "t_pose.facing":
        command = ["kinematics", "--imu", str(capture / "imu.csv.gz"), "--subject", str(path)]
        assert main([*command, "--out", str(tmp_path / "k.json")]) == 0
        assert capsys.readouterr().err.count("as its file does not state it") == 1
