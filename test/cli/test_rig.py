"""`panoptic rig check` and `panoptic rig convert`."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from panoptic_ros.cli.main import main
from panoptic_ros.domain import Camera, Rig
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.io.resources import share_folder
from panoptic_ros.io.rigs import read_rig, write_rig
from panoptic_ros.running.plans.bag_plan import plan_bags

TURN = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # level, looking along +y
BODY = {
    "nose": (0.0, 0.0, 1.6),
    "left_shoulder": (-0.2, 0.0, 1.4),
    "right_shoulder": (0.2, 0.0, 1.4),
    "left_hip": (-0.1, 0.0, 0.9),
    "right_hip": (0.1, 0.0, 0.9),
    "left_ankle": (-0.1, 0.1, 0.1),
}


@pytest.fixture
def rig() -> Rig:
    lens = Intrinsics(np.array([[800.0, 0, 320], [0, 800.0, 240], [0, 0, 1]]), np.zeros(5))
    places = np.array([(-1.5, -3.0, 1.2), (0.0, -3.5, 1.0), (1.5, -3.0, 1.5)])
    poses = [Rigid(TURN, -TURN @ place) for place in places]
    return Rig(tuple(Camera(f"c{i}", (640, 480), lens, pose) for i, pose in enumerate(poses)))


def write_detections(path: Path, rig: Rig) -> None:
    frames = []
    for index in range(6):
        points = np.array(list(BODY.values())) + [0.05 * index - 0.1, 0.1 * index, 0.0]
        views = {
            c.name: {"stamp_ns": index, "persons": [[[*p, 0.9] for p in c.project(points)[0].tolist()]]}
            for c in rig.cameras
        }
        frames.append({"index": index, "stamp_ns": index, "views": views})
    document = {"format": "panoptic-detections-1", "joint_names": list(BODY), "frames": frames}
    path.write_text(json.dumps(document))


def test_a_good_rig_is_reported_as_such(tmp_path: Path, rig: Rig, capsys: pytest.CaptureFixture[str]) -> None:
    write_rig(tmp_path / "rig.json", rig)
    write_detections(tmp_path / "d.json", rig)
    assert main(["rig", "check", str(tmp_path / "rig.json"), "--detections", str(tmp_path / "d.json")]) == 0
    out = capsys.readouterr().out
    assert "the views agree" in out and "c2" in out


def test_the_rig_of_a_capture_folder(tmp_path: Path, rig: Rig, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["rig", "check", str(tmp_path)]) == 2
    assert "has no rig" in capsys.readouterr().err
    write_rig(tmp_path / "rig.json", rig)
    assert main(["rig", "check", str(tmp_path)]) == 0
    assert main(["rig", "convert", str(tmp_path), str(tmp_path / "infos")]) == 0
    capsys.readouterr()
    assert main(["rig", "check", str(tmp_path / "infos")]) == 0
    assert "c2" in capsys.readouterr().out


def test_a_bad_rig_is_named_with_exit_code_2(
    tmp_path: Path, rig: Rig, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = Rig(tuple(replace(c, cam_from_world=c.cam_from_world.inverse()) for c in rig.cameras))
    write_rig(tmp_path / "rig.json", wrong)
    write_detections(tmp_path / "d.json", rig)
    command = ["rig", "check", str(tmp_path / "rig.json"), "--detections", str(tmp_path / "d.json")]
    assert main(command) == 2
    assert "warning: all cameras seem to have R and t of world_from_cam" in capsys.readouterr().out
    assert main([*command, "--json"]) == 2
    assert json.loads(capsys.readouterr().out)["notices"][0]["code"] == "rig.pose_inverted"


@pytest.mark.parametrize("results", [False, True])
def test_views_are_checked_by_the_detections_of_a_bag(
    tmp_path: Path, results: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    """The rig is the given one, not that of the bag: exchanged poses of two cameras are found."""
    sample = share_folder() / "bags" / "sample"
    (tmp_path / "bag").symlink_to(sample)
    rig = plan_bags([sample]).rig
    write_rig(tmp_path / "rig.json", rig)
    command = ["rig", "check", str(tmp_path / "rig.json"), "--detections"]
    command.append(str(tmp_path if results else sample))
    assert main(command) == 0
    assert "the views agree" in capsys.readouterr().out
    first, second, *others = rig.cameras
    poses = second.cam_from_world, first.cam_from_world
    swapped = [replace(c, cam_from_world=pose) for c, pose in zip((first, second), poses)]
    write_rig(tmp_path / "rig.json", replace(rig, cameras=(*swapped, *others)))
    assert main(command) == 2
    assert f"{first.name} and {second.name}" in capsys.readouterr().out


def test_convert(tmp_path: Path, rig: Rig, capsys: pytest.CaptureFixture[str]) -> None:
    write_rig(tmp_path / "a.qca.txt", rig)
    places = [str(tmp_path / "a.qca.txt"), str(tmp_path / "b.toml")]
    assert main(["rig", "convert", *places, "--cameras", "c2,c0"]) == 0
    assert read_rig(tmp_path / "b.toml").names == ("c0", "c2")
    assert "2 cameras" in capsys.readouterr().out


def test_convert_to_a_measured_distance_and_a_marked_floor(tmp_path: Path, rig: Rig) -> None:
    marks = np.array([[0.0, 0.0, 0.0], [0.4, 0.0, 0.0], [0.0, 0.5, 0.0]])
    half = [replace(c, cam_from_world=Rigid(TURN, 0.5 * c.cam_from_world.translation)) for c in rig.cameras]
    write_rig(tmp_path / "half.json", replace(rig, cameras=tuple(half)))
    rows = [
        f"p{n},{c.name},{c.project(mark)[0][0]},{c.project(mark)[0][1]}"
        for n, mark in enumerate(marks)
        for c in rig.cameras[:2]
    ]
    (tmp_path / "f.csv").write_text("\n".join(["point,camera,x,y", *rows]))
    apart = np.linalg.norm(rig.cameras[0].centre - rig.cameras[2].centre)
    options = ["--distance", f"c0,c2={apart}", "--floor-points", str(tmp_path / "f.csv")]
    assert main(["rig", "convert", str(tmp_path / "half.json"), str(tmp_path / "o.json"), *options]) == 0
    found = read_rig(tmp_path / "o.json")
    for own, true in zip(found.cameras, rig.cameras):
        np.testing.assert_allclose(own.centre, true.centre, atol=1e-6)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["check", "missing.json"], "No such file"),
        (["convert", "rig.json", "x.bvh"], "cannot write a rig as '.bvh'"),
        (["convert", "rig.json", "x.json", "--unit", "mm"], "has no use for unit"),
        (["convert", "rig.json", "x.json", "--panels", "one"], "not a list of whole numbers"),
        (["convert", "rig.json", "x.json", "--cameras", "c9"], "no camera 'c9'"),
        (["convert", "rig.json", "x.json", "--distance", "c0,c9=2"], "no camera 'c9'"),
        (["convert", "rig.json", "x.json", "--up=y", "--floor-points", "f.csv"], "give one of them"),
        (["convert", "rig.json", "x.json", "--floor-points", "f.csv"], "f.csv"),
    ],
)
def test_mistakes_of_the_user(
    tmp_path: Path,
    rig: Rig,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    says: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    write_rig(Path("rig.json"), rig)
    assert main(["rig", *arguments]) == 2
    error = capsys.readouterr().err
    assert says in error and error.count("\n") == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["rig.json"]
