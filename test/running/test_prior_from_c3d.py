"""Priors from C3D are those from the same motion in an .npz, whatever unit, axes and labels are."""

import sys

import numpy as np
import pytest
from bodies import MODEL, placed, some_pose

from panoptic_ros.cli.main import main
from panoptic_ros.geometry.rotations import rotations_of, vectors_of
from panoptic_ros.io.c3d_motion import read_c3d
from panoptic_ros.io.motion_files import read_sites
from panoptic_ros.io.pose_prior import read_prior
from panoptic_ros.kinematics.body.fitting import with_trunk

ezc3d = pytest.importorskip("ezc3d")
SITES = read_sites(MODEL)
NAMES = {MODEL.names[site.segment]: name for name, site in SITES.items() if not site.share.any()}
BONES = {"UpperArm": "HUP", "Forearm": "HUO", "Hand": "RAO", "Thigh": "FEP", "Shin": "FEO", "Foot": "TIO"}
PLUG_IN_GAIT = {f"{s}{segment}": f"{s.upper()}{name}" for s in "lr" for segment, name in BONES.items()}


@pytest.fixture(scope="module")
def motion():
    """Joints (T, S, 3) m of poses that follow each other."""
    rng = np.random.default_rng(4)
    begin, end = some_pose(1, 0.2), some_pose(2, 0.2)
    found = []
    for k in range(60):
        pose = begin.copy()
        pose.root[:] = begin.root + k / 60 * (end.root - begin.root)
        share = 0.5 - 0.5 * np.cos(k / 8)
        pose.turns[:] = np.array([_between(a, b, share) for a, b in zip(begin.turns, end.turns)])
        found.append(placed(pose)[1])
    return np.array(found) + rng.normal(0.0, 1e-4, (60, len(MODEL.names), 3))


def _between(a, b, share):
    return a @ rotations_of(share * vectors_of((a.T @ b)[None]))[0]


def write(path, joints, names, unit="mm", up=None, rate=120.0, prefix="Subject1:"):
    """A C3D file of joints (T, J, 3), m, z up; NaN = a sample that is missing."""
    file = ezc3d.c3d()
    axes = {None: [0, 1, 2], "+Y": [1, 2, 0]}[up]
    places = joints[..., axes] * {"mm": 1000.0, "m": 1.0}[unit]
    points = np.ones((4, joints.shape[1], len(joints)))
    points[:3] = np.moveaxis(places, -1, 0).swapaxes(1, 2)
    residuals = np.where(np.isfinite(points[:3]).all(0), 0.0, -1.0)[None]
    file["parameters"]["POINT"]["UNITS"]["value"] = [unit]
    file["parameters"]["POINT"]["RATE"]["value"] = [rate]
    file["parameters"]["POINT"]["LABELS"]["value"] = [prefix + name for name in names]
    if up is not None:
        file.add_parameter("POINT", "X_SCREEN", ["+X"])
        file.add_parameter("POINT", "Y_SCREEN", [up])
    file["data"]["points"] = np.nan_to_num(points)
    file["data"]["meta_points"]["residuals"] = residuals
    file["data"]["meta_points"]["camera_masks"] = np.zeros((7, joints.shape[1], len(joints)), bool)
    file.write(str(path))


@pytest.mark.parametrize("unit, up", [("mm", None), ("m", "+Y")])
def test_joints_are_where_they_were_in_metres_with_z_up(tmp_path, motion, unit, up):
    joints = motion.copy()
    joints[5:9, 3] = np.nan
    names = [NAMES[name] for name in MODEL.names if name in NAMES]
    kept = joints[:, [MODEL.index(name) for name in MODEL.names if name in NAMES]]
    write(tmp_path / "walk.c3d", kept, names, unit, up)
    found = read_c3d(tmp_path / "walk.c3d")
    assert found.rate == 120.0 and [name.split(":")[1] for name in found.joint_names] == names
    np.testing.assert_allclose(found.joints, kept, atol=1e-6)  # NaN in the same places


def train(path, out):
    assert main(["prior", "train", str(path), "--out", str(out)]) == 0
    return read_prior(str(out))


def test_a_prior_is_the_same_from_c3d_and_from_arrays(tmp_path, motion):
    kept = [name for name in MODEL.names if name in NAMES]
    joints = motion[:, [MODEL.index(name) for name in kept]].copy()
    joints[20:24, kept.index("lHand")] = np.nan
    names = [NAMES[name] for name in kept]
    write(tmp_path / "walk.c3d", joints, names)
    np.savez(tmp_path / "walk.npz", clips=["walk"], joint_names=names, fps=120.0, clip_walk=joints)
    found, wanted = (train(tmp_path / f"walk.{end}", tmp_path / f"{end}.prior.npz") for end in ("c3d", "npz"))
    np.testing.assert_allclose(found.mean, wanted.mean, atol=1e-3)
    assert found.projection.shape == wanted.projection.shape
    np.testing.assert_allclose(found.projection, wanted.projection, atol=0.02)


def test_bones_of_plug_in_gait_are_enough(tmp_path, motion):
    """They have no joint where our pelvis and neck begin; limbs are those of all joints."""
    kept = [name for name in MODEL.names if name in NAMES]
    write(tmp_path / "all.c3d", motion[:, [MODEL.index(n) for n in kept]], [NAMES[n] for n in kept])
    joints = motion[:, [MODEL.index(name) for name in PLUG_IN_GAIT]]
    write(tmp_path / "gait.c3d", joints, list(PLUG_IN_GAIT.values()))
    found, wanted = (train(tmp_path / f"{name}.c3d", tmp_path / f"{name}.npz") for name in ("gait", "all"))
    limbs = [MODEL.index(side + name) - 1 for side in "lr" for name in ("Thigh", "Shin", "Forearm")]
    apart = np.degrees((found.mean - wanted.mean).reshape(-1, 3)[limbs])
    assert np.abs(apart).max() < 5.0, "hips begin 3 mm elsewhere, so legs turn a little"


def test_pelvis_and_neck_begin_where_the_proportions_of_the_skeleton_put_them():
    pose = some_pose(3, 0.0)
    places = placed(pose)[1][None]
    names = [NAMES[name] for name in PLUG_IN_GAIT]
    named, joints = with_trunk(MODEL, SITES, names, places[:, [MODEL.index(name) for name in PLUG_IN_GAIT]])
    assert [MODEL.names[SITES[name].segment] for name in named[-2:]] == ["hips", "neck"]
    wanted = places[:, [MODEL.index("hips"), MODEL.index("neck")]]
    assert np.linalg.norm(joints[:, -2:] - wanted, axis=-1).max() < 0.03


@pytest.mark.parametrize(
    "harm, told",
    [
        (lambda data: b"", "not a C3D file"),
        (lambda data: b"<html>" + data[6:], "not a C3D file"),
        (lambda data: data[: len(data) // 3], "not an intact C3D file"),
        (lambda data: data[:600], "not an intact C3D file"),
    ],
)
def test_a_file_that_is_no_c3d_is_told_in_one_line(tmp_path, motion, capsys, harm, told):
    joints = motion[:, [MODEL.index(name) for name in PLUG_IN_GAIT]]
    write(tmp_path / "a.c3d", joints, list(PLUG_IN_GAIT.values()))
    (tmp_path / "a.c3d").write_bytes(harm((tmp_path / "a.c3d").read_bytes()))
    assert main(["prior", "train", str(tmp_path / "a.c3d"), "--out", str(tmp_path / "p.npz")]) == 2
    error = capsys.readouterr().err
    assert told in error and error.count("\n") == 1


def test_another_unit_is_told(tmp_path, motion, capsys):
    write(tmp_path / "a.c3d", motion[:, :2], ["LFEP", "RFEP"])
    file = ezc3d.c3d(str(tmp_path / "a.c3d"))
    file["parameters"]["POINT"]["UNITS"]["value"] = ["ell"]
    file.write(str(tmp_path / "b.c3d"))
    assert main(["prior", "train", str(tmp_path / "b.c3d"), "--out", str(tmp_path / "p.npz")]) == 2
    assert "POINT:UNITS is 'ell'; known are mm, cm, m, in" in capsys.readouterr().err


def test_a_missing_package_is_told_with_the_command(tmp_path, motion, capsys, monkeypatch):
    write(tmp_path / "a.c3d", motion[:, :2], ["LFEP", "RFEP"])
    monkeypatch.setitem(sys.modules, "ezc3d", None)
    assert main(["prior", "train", str(tmp_path / "a.c3d"), "--out", str(tmp_path / "p.npz")]) == 2
    assert "pip install ezc3d" in capsys.readouterr().err


def test_who_stands_still_trains_no_prior(tmp_path, capsys):
    pose = placed(some_pose(0, 0.0))[1][None].repeat(20, axis=0)
    write(tmp_path / "a.c3d", pose[:, [MODEL.index(name) for name in PLUG_IN_GAIT]], PLUG_IN_GAIT.values())
    assert main(["prior", "train", str(tmp_path / "a.c3d"), "--out", str(tmp_path / "p.npz")]) == 2
    assert "a prior is trained on motion" in capsys.readouterr().err
