"""`panoptic solve` says what `panoptic rig check` says, and why nobody was found."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import captures
import numpy as np
import pytest

from panoptic_ros.cli.main import main
from panoptic_ros.domain import DetectionSet, Rig, ViewDetections
from panoptic_ros.evaluation.nobody import why_nobody
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.io.plain_formats import read_skeletons, write_detections
from panoptic_ros.io.rigs import write_rig

FRAMES = 12
SKELETON = captures.SKELETON
Views = list[ViewDetections]


def solve(folder: Path, rig: Rig, views: Views) -> int:
    """Exit code of `solve` on files."""
    sets = []
    for index in sorted({view.frame_number for view in views}):
        own = tuple(view for view in views if view.frame_number == index)
        sets.append(DetectionSet(index, min(view.stamp_ns for view in own), SKELETON.hash, own))
    write_rig(folder / "rig.json", rig)
    write_detections(folder / "d.json", SKELETON.joint_names, sets)
    command = ["--rig", str(folder / "rig.json"), "--detections", str(folder / "d.json")]
    return main(["solve", *command, "--out", str(folder / "s.json.gz")])


def posed(rig: Rig, change: Callable[[Rigid], Rigid]) -> Rig:
    cameras = (replace(camera, cam_from_world=change(camera.cam_from_world)) for camera in rig.cameras)
    return replace(rig, cameras=tuple(cameras))


def feet(rig: Rig) -> Rig:
    return posed(rig, lambda pose: Rigid(pose.rotation, 3.2808 * pose.translation))


def inverse(rig: Rig) -> Rig:
    return posed(rig, Rigid.inverse)


def named_otherwise(rig: Rig) -> Rig:
    a, b, *others = rig.cameras
    return replace(rig, cameras=(replace(b, name=a.name), replace(a, name=b.name), *others))


def lenses_exchanged(rig: Rig) -> Rig:
    a, b, *others = rig.cameras
    first, second = replace(a, intrinsics=b.intrinsics), replace(b, intrinsics=a.intrinsics)
    return replace(rig, cameras=(first, second, *others))


def lens_in_another_order(rig: Rig) -> Rig:
    lens = Intrinsics(rig.cameras[0].intrinsics.matrix, [-0.3, 0.1, -0.1, 1e-3, 2e-4])
    return replace(rig, cameras=(replace(rig.cameras[0], intrinsics=lens), *rig.cameras[1:]))


def one_pose(rig: Rig) -> Rig:
    a, b, *others = rig.cameras
    return replace(rig, cameras=(a, replace(b, cam_from_world=a.cam_from_world), *others))


def y_down(rig: Rig) -> Rig:
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    return posed(rig, lambda pose: Rigid(pose.rotation @ turn.T, pose.translation))


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (feet, "its lengths look like feet, not metres"),
        (inverse, "R and t of world_from_cam"),
        (named_otherwise, "cameras cam0 and cam1 look exchanged"),
        (lens_in_another_order, "looks like k1 k2 k3 p1 p2"),
        (one_pose, "cameras cam0 and cam1 have one and the same pose"),
        (y_down, "`panoptic rig convert IN OUT --up=-y` turns it"),
    ],
)
def test_solve_warns_as_rig_check_does(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], wrong: Callable[[Rig], Rig], says: str
) -> None:
    assert solve(tmp_path, wrong(captures.RIG), captures.views(FRAMES)) == 0
    error = capsys.readouterr().err
    assert says in error and all(line.startswith(("warning: ", "1", "2", "3")) for line in error.splitlines())
    command = ["rig", "check", str(tmp_path / "rig.json"), "--detections", str(tmp_path / "d.json"), "--json"]
    assert main(command) == 2
    told = [note["text"] for note in json.loads(capsys.readouterr().out)["notices"]]
    assert any(says in text for text in told)


def test_exchanged_lenses_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wide, narrow, *others = captures.RIG.cameras
    lens = narrow.intrinsics
    tele = Intrinsics([[1100.0, 0, 640], [0, 1100.0, 360], [0, 0, 1]], lens.distortion)
    rig = Rig((wide, replace(narrow, intrinsics=tele), *others))
    views = []
    for view in captures.views(FRAMES):
        camera = rig.camera(view.camera)
        pixels, _ = camera.project(captures.people(view.stamp_ns * 1e-9))
        views.append(replace(view, points=pixels, scores=0.0 * view.scores + 0.9))
    assert solve(tmp_path, lenses_exchanged(rig), views) == 0
    assert "the intrinsics of cameras cam0 and cam1 look exchanged" in capsys.readouterr().err
    assert solve(tmp_path, rig, views) == 0
    assert capsys.readouterr().err == ""


def alone(views: Views, apart_ns: int = 1_000_000_000) -> Views:
    """Every camera at instants of its own, in frames of one view."""
    at = {name: k for k, name in enumerate(captures.RIG.names)}
    moved = [replace(view, stamp_ns=view.stamp_ns + apart_ns * at[view.camera]) for view in views]
    moved.sort(key=lambda view: view.stamp_ns)
    return [replace(view, frame_number=k) for k, view in enumerate(moved)]


def emptied(view: ViewDetections) -> ViewDetections:
    return replace(view, points=view.points[:0], scores=view.scores[:0], person_scores=view.person_scores[:0])


def in_turn(views: Views) -> Views:
    """Everybody is seen by one camera at a time."""
    names = captures.RIG.names
    return [view if view.frame_number % 4 == names.index(view.camera) else emptied(view) for view in views]


def faint(view: ViewDetections) -> ViewDetections:
    return replace(view, scores=0.05 * view.scores)


def in_few_joints(view: ViewDetections) -> ViewDetections:
    few = np.arange(view.scores.shape[1]) < 3
    return replace(
        view, scores=np.where(few, view.scores, 0.0), points=np.where(few[:, None], view.points, np.nan)
    )


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (faint, "half of the joints have scores of 0.045 or less; scores from 0.2 on count"),
        (in_few_joints, "half of the people have 3 joints or fewer of this skeleton"),
        (lambda view: view, "the rays of people meet, so look at the parameters of assembly and tracking"),
    ],
)
def test_reasons_that_people_have(change: Callable[[ViewDetections], ViewDetections], says: str) -> None:
    views = list(map(change, captures.views(FRAMES)))
    at = [tuple(view for view in views if view.frame_number == k) for k in range(FRAMES)]
    sets = [DetectionSet(k, k, SKELETON.hash, own) for k, own in enumerate(at)]
    (note,) = why_nobody(sets, 0, ())
    assert note.text.startswith("no people were found in 3D although the views show 96 2D people: ")
    assert says in note.text
    assert why_nobody(sets, 2 * FRAMES, ()) == [] == why_nobody(sets[:1], 0, ())


def test_nobody_out_of_many_names_the_reason(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    says = "no two views of an instant show people"
    assert solve(tmp_path, captures.RIG, in_turn(captures.views(FRAMES))) == 0
    assert all(not len(frame.ids) for frame in read_skeletons(tmp_path / "s.json.gz").frames)
    error = capsys.readouterr().err
    assert "warning: no people were found in 3D although the views show" in error and says in error


@pytest.mark.parametrize("apart_ns", [0, 2_000_000])
def test_views_one_by_one_are_grouped(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], apart_ns: int
) -> None:
    assert solve(tmp_path, captures.RIG, alone(captures.views(FRAMES), apart_ns)) == 0
    frames = read_skeletons(tmp_path / "s.json.gz").frames
    assert [len(frame.ids) for frame in frames] == [2] * FRAMES
    told = capsys.readouterr()
    assert f"views come one per frame in {tmp_path / 'd.json'}; they are grouped into 12 sets" in told.out
    assert told.err == ""


def test_slow_cameras_that_never_expose_together_call_for_another_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert solve(tmp_path, captures.RIG, alone(captures.views(20, rate=10), apart_ns=25_000_000)) == 0
    assert any(len(frame.ids) for frame in read_skeletons(tmp_path / "s.json.gz").frames)
    (line,) = [line for line in capsys.readouterr().err.splitlines() if "continuous" in line]
    assert line.startswith("warning: cameras of 10.0 Hz expose 75 ms apart")
    assert line.endswith("use `panoptic continuous` with the same --rig and --detections")


def test_a_rig_that_is_wrong_is_the_reason(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    turn = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    wrong = posed(captures.RIG, lambda pose: Rigid(turn @ pose.rotation, pose.translation))
    solve(tmp_path, wrong, captures.views(FRAMES))
    found = sum(len(frame.ids) for frame in read_skeletons(tmp_path / "s.json.gz").frames)
    error = capsys.readouterr().err
    assert "does not agree with the others" in error
    assert found > 0 or "the check of the rig reports the reason: camera" in error


def test_an_empty_room_is_no_mistake(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert solve(tmp_path, captures.RIG, list(map(emptied, captures.views(FRAMES)))) == 0
    assert capsys.readouterr().err == ""
