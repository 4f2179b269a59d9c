"""`panoptic calibrate --pattern`: from images of a random pattern to a rig with its report; refusals."""

import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest

from panoptic_ros.cli.main import main
from panoptic_ros.domain import Rig
from panoptic_ros.geometry import Rigid
from panoptic_ros.geometry.rotations import rotations_of
from panoptic_ros.io.rigs import read_rig, write_rig
from test.support.pattern_images import write_pattern_session


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pattern") / "images"
    truth = write_pattern_session(folder, 3)
    unknown = [replace(camera, cam_from_world=Rigid.identity()) for camera in truth.cameras]
    write_rig(folder.parent / "lenses.json", Rig(tuple(unknown)))
    return folder, truth


def calibrate(folder, out, *options):
    return main(["calibrate", str(folder), "--pattern", "--out", str(out), *map(str, options)])


def distances(rig):
    centres = np.stack([camera.centre for camera in rig.cameras])
    return np.linalg.norm(centres[:, None] - centres[None], axis=2)


def tape(truth):
    return f"cam0,cam3={distances(truth)[0, 3]:.6f}"


def test_images_of_a_pattern_give_a_rig_with_its_report(session, tmp_path, capsys):
    folder, truth = session
    lenses = folder.parent / "lenses.json"
    assert calibrate(folder, tmp_path / "o", "--intrinsics", lenses, "--distance", tape(truth)) == 0
    out, err = capsys.readouterr()
    assert "predicted error where the target was shown" in out and "Traceback" not in err
    found = read_rig(tmp_path / "o" / "rig.json")
    assert found.names == truth.names and all(camera.covariance is not None for camera in found.cameras)
    np.testing.assert_allclose(distances(found), distances(truth), atol=0.01)
    page = (tmp_path / "o" / "report.html").read_text()
    assert all(name in page and (tmp_path / "o" / f"{name}.png").exists() for name in truth.names)


def test_approximate_poses_are_refined(session, tmp_path):
    folder, truth = session
    rng = np.random.default_rng(1)
    turns = rotations_of(0.01 * rng.standard_normal((len(truth), 3)))
    near = [
        replace(c, cam_from_world=Rigid(t, np.zeros(3)).compose(c.cam_from_world))
        for c, t in zip(truth.cameras, turns)
    ]
    write_rig(tmp_path / "near.json", Rig(tuple(near)))
    options = ("--intrinsics", tmp_path / "near.json", "--refine", "--distance", tape(truth))
    assert calibrate(folder, tmp_path / "o", *options) == 0
    np.testing.assert_allclose(distances(read_rig(tmp_path / "o" / "rig.json")), distances(truth), atol=0.01)


def refused(capsys, folder, out, *options):
    assert calibrate(folder, out, *options) == 2
    err = capsys.readouterr().err.strip()
    assert not (out / "rig.json").exists() and "Traceback" not in err and len(err.splitlines()) == 1
    return err


def test_refusals_name_the_fault(session, tmp_path, capsys):
    folder, truth = session
    lenses, out = folder.parent / "lenses.json", tmp_path / "o"
    assert "--intrinsics RIG" in refused(capsys, folder, out, "--distance", tape(truth))
    assert "--distance CAM_A,CAM_B=M" in refused(capsys, folder, out, "--intrinsics", lenses)
    known = ("--intrinsics", lenses, "--distance")
    assert "no camera cam9" in refused(capsys, folder, out, *known, "cam0,cam9=1")
    some = tmp_path / "some.json"
    write_rig(some, truth.subset(truth.names[:3]))
    assert "cam3" in refused(capsys, folder, out, "--intrinsics", some, "--distance", "cam0,cam1=1")
    short = tmp_path / "short"
    shutil.copytree(folder, short)
    (short / "cam2" / "0002.png").unlink()
    assert "camera cam2 has 2 images" in refused(capsys, short, out, *known, "cam0,cam1=1")


def test_a_camera_that_sees_no_pattern_is_named(session, tmp_path, capsys):
    folder, _ = session
    blank = tmp_path / "blank"
    shutil.copytree(folder, blank)
    for path in (blank / "cam1").iterdir():
        cv2.imwrite(str(path), np.full((480, 640), 120, np.uint8))
    known = ("--intrinsics", folder.parent / "lenses.json", "--distance", "cam0,cam3=1")
    assert "camera cam1 (0)" in refused(capsys, blank, tmp_path / "o", *known)


def test_a_pattern_is_printed(tmp_path, capsys):
    path = tmp_path / "pattern.pdf"
    assert main(["calibrate", "print", "pattern", "--out", str(path)]) == 0
    assert path.read_bytes().startswith(b"%PDF") and "a4 paper" in capsys.readouterr().out
    assert main(["calibrate", "print", "pattern", "--out", str(tmp_path / "pattern.png")]) == 2
