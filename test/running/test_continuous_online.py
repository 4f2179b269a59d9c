"""`panoptic continuous --lag`: what the online form would have said about a file."""

from dataclasses import replace

import captures
import numpy as np
import pytest
from free_cameras import START_NS, FreeCapture

from panoptic_ros.cli.main import main
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.pipeline import records_of
from panoptic_ros.io.plain_formats import read_skeletons, write_detections
from panoptic_ros.io.rigs import write_rig

CAPTURE = FreeCapture(seconds=2.0)
SECOND = 1_000_000_000


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("capture")
    write_rig(folder / "rig.json", CAPTURE.rig)
    write_detections(folder / "d.json.gz", captures.SKELETON.joint_names, CAPTURE.sets)
    one = [item for item in CAPTURE.sets if item.views[0].camera == "cam1"]
    write_detections(folder / "one.json.gz", captures.SKELETON.joint_names, one)
    return folder


def run(files, out, *words, detections="d.json.gz"):
    given = ["--rig", files / "rig.json", "--detections", files / detections, "--out", out, "--lag", *words]
    return main(["continuous", *map(str, given)])


def test_the_result_is_that_of_the_stage(files, tmp_path, capsys):
    assert run(files, tmp_path / "s.json.gz", 0.1, "--rate", 40) == 0
    assert "s.json.gz: 79 instants, 2 people" in capsys.readouterr().out
    found = read_skeletons(tmp_path / "s.json.gz").frames
    configs = configure({"continuous": {"active": True, "rate_hz": 40.0, "lag": 0.1}})
    views = [item.views[0] for item in CAPTURE.sets]
    sets = records_of("skeletons_at", views, configs, CAPTURE.context, ["continuous"])
    for one, other in zip(found, sets, strict=True):
        assert one.stamp_ns == other.stamp_ns and one.ids.tolist() == other.ids.tolist()
        np.testing.assert_allclose(one.positions, other.positions, atol=1e-3)  # 2D points are rounded


def test_a_longer_lag_is_more_accurate(files, tmp_path):
    errors = []
    for lag in (0.0, 0.5):
        assert run(files, tmp_path / "s.json.gz", lag, "--quiet") == 0
        gaps = []
        for frame in read_skeletons(tmp_path / "s.json.gz").frames[40:-60]:
            truth = CAPTURE.joints(1e-9 * (frame.stamp_ns - START_NS))
            gaps += [np.linalg.norm(truth - body, axis=-1).mean(axis=1).min() for body in frame.positions]
        errors.append(np.mean(gaps))
    assert errors[1] < 0.5 * errors[0] and errors[1] < 2.5e-3


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("2",), "argument --lag: '2' is not a number from 0 to 1"),
        (("0.1", "--clocks"), "--lag does not go with --clocks, which"),
        (("0.1", "--curves", "c.npz", "--at", "a.csv"), "--lag does not go with --at and --curves, which"),
        (("0.1", "--rate", "5000"), "--rate 5000 with --lag is above 1000 Hz"),
    ],
)
def test_options_that_do_not_go_together_are_named(files, tmp_path, capsys, words, text):
    assert run(files, tmp_path / "s.json.gz", *words) == 2
    assert text in capsys.readouterr().err and not (tmp_path / "s.json.gz").exists()


def test_one_camera_is_not_enough(files, tmp_path, capsys):
    assert run(files, tmp_path / "s.json.gz", 0.1, detections="one.json.gz") == 2
    told = capsys.readouterr().err
    assert "views of cam1 alone; give 2D people of at least two cameras" in told
    assert not (tmp_path / "s.json.gz").exists()


@pytest.mark.parametrize(
    ("stamp", "text"),
    [
        (lambda ns: ns + SECOND, "stamps of camera cam3 are 1.00 s ahead of those of the other cameras"),
        (lambda ns: ns - SECOND, "stamps of camera cam3 are 1.00 s behind those of the other cameras"),
        (
            lambda ns: 2 * START_NS + 6 * SECOND - ns,
            "because their stamps repeat or run backwards: cam3 (59)",
        ),
    ],
)
def test_a_camera_with_wrong_stamps_is_named_in_one_line(files, tmp_path, capsys, stamp, text):
    capture = FreeCapture(seconds=6.0, speed=2.0)
    sets = []
    for item in capture.sets:
        (view,) = item.views
        right = view.stamp_ns
        moved = replace(view, stamp_ns=stamp(right) if view.camera == "cam3" else right)
        sets.append(replace(item, stamp_ns=moved.stamp_ns, views=(moved,)))
    write_detections(tmp_path / "d.json.gz", captures.SKELETON.joint_names, sets)
    assert run(files, tmp_path / "s.json.gz", 0.1, "--quiet", detections=tmp_path / "d.json.gz") == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("warning: ") and text in line
    for frame in read_skeletons(tmp_path / "s.json.gz").frames[40:-40]:
        truth = capture.joints(1e-9 * (frame.stamp_ns - START_NS))
        gaps = np.linalg.norm(truth[:, None] - frame.positions, axis=-1).mean(axis=-1)
        assert len(frame.ids) == 2 and gaps.min(axis=1).max() < 0.01
