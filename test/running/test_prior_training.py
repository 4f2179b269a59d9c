"""Priors from recorded motion: what is fitted is what was recorded, and what is shipped can be made again."""

import json

import numpy as np
import pytest
from bodies import CHAIN, MODEL, S, placed, some_pose

from panoptic_ros.cli.main import main
from panoptic_ros.io.motion_files import read_bvh, read_sites
from panoptic_ros.io.pose_prior import read_prior
from panoptic_ros.io.recorded_motions import MOTION
from panoptic_ros.io.resources import share_folder
from panoptic_ros.kinematics.body.fitting import fit_motion

BVH = """HIERARCHY
ROOT Hips { OFFSET 0 0 0 CHANNELS 6 Xposition Yposition Zposition Zrotation Yrotation Xrotation
  JOINT mixamo:LeftUpLeg { OFFSET 10 0 0 CHANNELS 3 Zrotation Yrotation Xrotation
    JOINT LeftLeg { OFFSET 0 -40 0 CHANNELS 3 Zrotation Yrotation Xrotation End Site { OFFSET 0 -40 0 } } } }
MOTION Frames: 2 Frame Time: 0.02
0 100 0 0 0 0 0 0 0 0 0 0
10 100 0 0 90 0 0 0 -90 0 0 0
"""


def test_joints_of_a_bvh_are_where_the_turns_put_them(tmp_path):
    (tmp_path / "walk.bvh").write_text(BVH)
    motion = read_bvh(tmp_path / "walk.bvh", 0.01)
    assert motion.rate == pytest.approx(50.0) and motion.name == "walk"
    np.testing.assert_allclose(motion.joints[0, :3], [[0, 0, 1], [0, 0.1, 1], [0, 0.1, 0.6]], atol=1e-9)
    # a quarter turn about the vertical points the left hip back; the shin follows the turn of the thigh
    np.testing.assert_allclose(motion.joints[1, :2], [[0, 0.1, 1], [-0.1, 0.1, 1]], atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(motion.joints[1, 2] - motion.joints[1, 1]), 0.4)


CUT = ("", "HIERARCHY\nROOT a { OFFSET 0 0", BVH.replace("Frames: 2", "Frames: 3"))


@pytest.mark.parametrize("text", CUT)
def test_a_bvh_that_is_not_whole_is_told(tmp_path, text, capsys):
    (tmp_path / "cut.bvh").write_text(text)
    assert main(["prior", "train", str(tmp_path / "cut.bvh"), "--out", str(tmp_path / "p.npz")]) == 2
    assert "cut.bvh is no BVH file that is whole" in capsys.readouterr().err


def test_poses_are_found_again_from_joints():
    sites = read_sites(MODEL)
    names = {site.segment: name for name, site in sites.items() if not site.share.any()}
    segments = list(names)
    poses = [some_pose(k, 0.15) for k in range(12)]
    joints = np.array([placed(pose)[1][segments] for pose in poses])
    fit = fit_motion(MODEL, sites, [names[s] for s in segments], joints)
    assert fit.residual < 0.01
    limbs = [MODEL.index(name) for name in ("lForearm", "rHand", "lShin", "rFoot")]
    np.testing.assert_allclose(fit.offsets[limbs], CHAIN.offsets[limbs], atol=1e-3)
    assert fit.vectors.shape == (12, S, 3)


def test_the_prior_that_is_shipped_is_made_by_the_command(tmp_path, capsys):
    motion = share_folder() / "config" / "bodies" / MOTION
    assert main(["prior", "train", str(motion), "--out", str(tmp_path / "prior.npz")]) == 0
    assert "components" in capsys.readouterr().out
    made, shipped = read_prior(str(tmp_path / "prior.npz")), read_prior()
    np.testing.assert_allclose(made.mean, shipped.mean, atol=1e-5)
    np.testing.assert_allclose(made.projection, shipped.projection, atol=1e-3)


def test_what_is_no_motion_is_told(tmp_path, capsys):
    (tmp_path / "k.json").write_text(json.dumps({"format": "other"}))
    for name, told in (("k.json", "no panoptic-kinematics-1"), ("a.fbx", "motion is read from")):
        assert main(["prior", "train", str(tmp_path / name), "--out", str(tmp_path / "p.npz")]) == 2
        assert told in capsys.readouterr().err
