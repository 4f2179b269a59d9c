"""Human3.6M: cameras and joints that the test writes in the formats of the data set; no test on the data."""

import sys

import numpy as np
import pytest

from panoptic_ros.cli.main import main
from panoptic_ros.io.compared_skeletons import read_sequence
from panoptic_ros.io.datasets.human36m import NAMED, SIZES
from panoptic_ros.io.rigs import read_rig

cdflib = pytest.importorskip("cdflib")
RNG = np.random.default_rng(8)
POSES = RNG.uniform(-1.0, 1.0, (4, 11, 6)) * [3.0, 1.5, 3.0, 5000.0, 5000.0, 2000.0]
LENSES = np.tile([1145.0, 1143.0, 512.0, 515.0, -0.2, 0.25, -0.003, -0.001, 0.002], (4, 1))
JOINTS = RNG.normal([0.0, 0.0, 1.0], 0.5, (6, 32, 3))  # m


def write_cdf(path, name, values):
    path.parent.mkdir(parents=True, exist_ok=True)
    file = cdflib.cdfwrite.CDF(str(path), cdf_spec={"Compressed": 1}, delete=True)
    shape = list(values.shape[1:])
    file.write_var(
        {"Variable": name, "Data_Type": 44, "Num_Elements": 1, "Rec_Vary": True, "Dim_Sizes": shape},
        var_data=values.astype(np.float32),
    )
    file.close()


def write_data(folder):
    numbers = " ".join(f"{value:.10g}" for value in [*POSES.ravel(), *LENSES.ravel()])
    folder.mkdir(exist_ok=True)
    (folder / "metadata.xml").write_text(f"<Metadata><mapping/><w0>[{numbers}]</w0></Metadata>")
    write_cdf(folder / "S9/MyPoseFeatures/D3_Positions/Walking 1.cdf", "Pose", 1e3 * JOINTS.reshape(1, 6, 96))
    write_cdf(folder / "S11/MyPoseFeatures/D3_Positions/Walking 1.cdf", "Pose", np.zeros((1, 6, 96)))
    (folder / "S9/Videos").mkdir()
    (folder / "S9/Videos/Walking 1.58860488.mp4").write_bytes(b"a video")


def imported(folder, out, take="S9/Walking 1"):
    return main(["import", "human3.6m", str(folder), "--take", take, "--out", str(out)])


def test_a_take_becomes_a_rig_and_the_truth_of_its_joints(tmp_path):
    write_data(tmp_path / "data")
    out = tmp_path / "capture"
    assert imported(tmp_path / "data", out) == 0
    truth = read_sequence(out / "truth.json.gz")
    assert [frame.stamp_ns for frame in truth.frames] == [20_000_000 * k for k in range(6)]
    for frame, joints in zip(truth.frames, JOINTS):
        np.testing.assert_allclose(frame.positions[0], joints[list(NAMED.values())], atol=2e-5)
    rig = read_rig(out / "rig.json")
    assert {camera.name: camera.image_size for camera in rig.cameras} == SIZES
    for camera, poses in zip(rig.cameras, POSES):
        a, b, c = poses[8, :3]
        x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
        y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
        z = np.array([[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]])
        np.testing.assert_allclose(camera.cam_from_world.rotation, x @ y @ z, atol=1e-8)
        np.testing.assert_allclose(camera.centre, 1e-3 * poses[8, 3:], atol=1e-6)
        np.testing.assert_allclose(camera.intrinsics.matrix[0], [1145.0, 0.0, 512.0])
        np.testing.assert_allclose(camera.intrinsics.distortion, [-0.2, 0.25, -0.001, 0.002, -0.003])
    assert (out / "58860488.mp4").read_bytes() == b"a video"


def test_whether_cameras_and_joints_belong_together_is_told(tmp_path, capsys):
    write_data(tmp_path / "data")
    assert imported(tmp_path / "data", tmp_path / "capture") == 0
    assert "the true pelvis is in the images of" in capsys.readouterr().out


def test_a_result_is_compared_with_the_truth(tmp_path, capsys):
    write_data(tmp_path / "data")
    assert imported(tmp_path / "data", tmp_path / "capture") == 0
    truth = str(tmp_path / "capture" / "truth.json.gz")
    assert main(["evaluate", truth, truth]) == 0
    assert "MPJPE" in capsys.readouterr().out


@pytest.mark.parametrize(
    "harm, told",
    [
        (lambda d: (d / "metadata.xml").write_text("<a><w0>[1 2 3]</w0></a>"), "3 numbers, expected 300"),
        (lambda d: (d / "metadata.xml").write_text("<a><w0>[1 2"), "is not valid XML"),
        (lambda d: (d / "metadata.xml").unlink(), "has no metadata.xml"),
        (lambda d: next(d.rglob("S9/**/*.cdf")).write_bytes(b"PK"), "is not a CDF file"),
        (
            lambda d: next(d.rglob("S9/**/*.cdf")).write_bytes(b"\xcd\xf3\x00\x01 no more"),
            "is not a CDF file",
        ),
        (lambda d: write_cdf(next(d.rglob("S9/**/*.cdf")), "Pose", np.zeros((1, 6, 51))), "6 x 51, expected"),
        (lambda d: write_cdf(next(d.rglob("S9/**/*.cdf")), "Angles", np.zeros((1, 6, 96))), "with `Pose`"),
    ],
)
def test_a_file_that_is_not_as_it_must_be_is_told_in_one_line(tmp_path, capsys, harm, told):
    write_data(tmp_path / "data")
    harm(tmp_path / "data")
    assert imported(tmp_path / "data", tmp_path / "capture") == 2
    error = capsys.readouterr().err
    assert told in error and error.count("\n") == 1


def test_subjects_takes_and_a_missing_package_are_told(tmp_path, capsys, monkeypatch):
    write_data(tmp_path / "data")
    for take, told in (("walk/1", "are S1 to S11"), ("S9/Eating", "has no eating.cdf")):
        assert imported(tmp_path / "data", tmp_path / "capture", take) == 2
        assert told in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "cdflib", None)
    assert imported(tmp_path / "data", tmp_path / "capture") == 2
    assert "pip install cdflib" in capsys.readouterr().err
