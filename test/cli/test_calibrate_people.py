"""`panoptic calibrate --people`: from 2D poses of people who walk to a rig with its report."""

from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.cli.main import main
from panoptic_ros.domain import DetectionSet
from panoptic_ros.geometry import Rigid
from panoptic_ros.io.bags import BagWriter
from panoptic_ros.io.clock_files import read_clocks
from panoptic_ros.io.messages import bag_messages, to_message
from panoptic_ros.io.plain_formats import write_detections
from panoptic_ros.io.rigs import read_rig, write_rig
from panoptic_ros.simulation.degradation import MILD
from panoptic_ros.simulation.people_sessions import PeopleScene, simulate_people
from panoptic_ros.simulation.rigs import Corners
from panoptic_ros.simulation.skeleton import SKELETON


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    """Folder with 2D poses, and a rig whose poses mean nothing."""
    folder = tmp_path_factory.mktemp("capture")
    session = simulate_people(PeopleScene(Corners(3), degradation=MILD, seconds=3.0, rate_hz=15.0), 0)
    count = len(session.rig)
    sets = [
        DetectionSet(k, own[0].stamp_ns, SKELETON.hash, tuple(own))
        for k, own in enumerate(zip(*[iter(session.views)] * count))
    ]
    write_detections(folder / "detections.json.gz", SKELETON.joint_names, sets)
    unknown = [replace(camera, cam_from_world=Rigid.identity()) for camera in session.rig.cameras]
    write_rig(folder / "rig.json", replace(session.rig, cameras=tuple(unknown)))
    return folder, session


def calibrate(folder, *options):
    return main(["calibrate", str(folder), "--people", *map(str, options)])


def test_people_give_a_rig_with_its_report(capture, tmp_path, capsys):
    folder, session = capture
    assert calibrate(folder, "--out", tmp_path / "o") == 0
    out, err = capsys.readouterr()
    assert "predicted error where people walked" in out and "scale" in err
    found = read_rig(tmp_path / "o" / "rig.json")
    assert found.names == session.rig.names and all(c.covariance is not None for c in found.cameras)
    a, b = (np.stack([camera.centre for camera in rig.cameras]) for rig in (found, session.rig))
    np.testing.assert_allclose(a[:, 2], b[:, 2], rtol=0.1, atol=0.1)  # the floor is z = 0
    ratios = np.linalg.norm(a[1:] - a[0], axis=1) / np.linalg.norm(b[1:] - b[0], axis=1)
    assert np.ptp(ratios) < 0.01
    assert set(read_clocks(tmp_path / "o" / "clocks.json")) == set(found.names)
    assert all(name in (tmp_path / "o" / "report.html").read_text() for name in found.names)


def test_a_measured_distance_gives_metres_and_no_clocks_are_written_for_synchronous_cameras(
    capture, tmp_path
):
    folder, session = capture
    first, second = session.rig.cameras[:2]
    metres = np.linalg.norm(first.centre - second.centre)
    given = ["--distance", f"{first.name},{second.name}={metres}", "--synchronous", "--quiet"]
    assert calibrate(folder, *given, "--out", tmp_path / "o") == 0
    found = read_rig(tmp_path / "o" / "rig.json").cameras
    assert np.linalg.norm(found[0].centre - found[1].centre) == pytest.approx(metres, abs=1e-6)
    assert not (tmp_path / "o" / "clocks.json").exists()


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--distance", "a,b"], "write CAM_A,CAM_B=METRES"),
        (["--distance", "corner0,no=2.0"], "no camera 'no'"),
        (["--stature", "17"], "17"),
    ],
)
def test_wrong_options_are_refused_in_one_line(capture, tmp_path, capsys, options, text):
    try:
        code = calibrate(capture[0], *options, "--out", tmp_path / "o")
    except SystemExit as end:
        code = end.code
    assert code == 2
    err = capsys.readouterr().err.strip().splitlines()
    assert text in err[-1] and "Traceback" not in "".join(err)
    assert not (tmp_path / "o").exists()


def test_poses_without_intrinsics_are_refused(capture, tmp_path, capsys):
    alone = tmp_path / "detections.json.gz"
    alone.write_bytes((capture[0] / "detections.json.gz").read_bytes())
    for source in (alone, tmp_path):
        assert calibrate(source, "--out", tmp_path / "o") == 2
        assert "--intrinsics" in capsys.readouterr().err
    assert calibrate(alone, "--intrinsics", capture[0] / "rig.json", "--out", tmp_path / "o", "--quiet") == 0


def test_the_scale_options_are_for_people(tmp_path, capsys):
    assert main(["calibrate", str(tmp_path), "--stature", "1.8", "--out", str(tmp_path / "o")]) == 2
    assert "--people" in capsys.readouterr().err


def test_bare_intrinsics_serve_for_a_file_and_a_bag_of_detections(capture, tmp_path):
    folder, session = capture
    write_rig(tmp_path / "info", session.rig, "camera_info")
    (tmp_path / "info" / "poses.yaml").unlink()
    alone = tmp_path / "poses" / "detections.json.gz"
    alone.parent.mkdir()
    alone.write_bytes((folder / "detections.json.gz").read_bytes())
    with BagWriter(tmp_path / "bag") as bag:
        for view in session.views:
            bag.write(f"/{view.camera}/detections", view.stamp_ns, to_message(view, bag_messages()))
    found = []
    for k, source in enumerate((alone, alone.parent, tmp_path / "bag")):
        out = tmp_path / f"o{k}"
        assert calibrate(source, "--intrinsics", tmp_path / "info", "--out", out, "--quiet") == 0
        found.append(np.stack([camera.centre for camera in read_rig(out / "rig.json").cameras]))
    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_allclose(found[0], found[2], atol=0.05)
