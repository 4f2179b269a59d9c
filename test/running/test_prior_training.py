"""Priors from recorded motion: what is fitted is what was recorded, and what is shipped can be made again."""

import json
import re

import numpy as np
import pytest
from bodies import CHAIN, MODEL, S, placed, some_pose

from panoptic_ros.cli.main import main
from panoptic_ros.io.motion_files import JointTrajectories, named_plainly, read_bvh, read_sites
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
    assert "cut.bvh is not an intact BVH file" in capsys.readouterr().err


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
    for name, told in (("k.json", "not a panoptic-kinematics-1"), ("a.fbx", "motion is read from")):
        assert main(["prior", "train", str(tmp_path / name), "--out", str(tmp_path / "p.npz")]) == 2
        assert told in capsys.readouterr().err


BODY = {  # joint: parent and offset in cm, y up, in a T
    "Hips": ("", (0, 95, 0)),
    "Chest": ("Hips", (0, 20, 0)),
    "Neck": ("Chest", (0, 32, 0)),
    "Head": ("Neck", (0, 9, 1)),
    "LeftCollar": ("Chest", (3, 26, 0)),
    "LeftShoulder": ("LeftCollar", (14, 0, 0)),
    "LeftElbow": ("LeftShoulder", (28, 0, 0)),
    "LeftWrist": ("LeftElbow", (25, 0, 0)),
    "RightCollar": ("Chest", (-3, 26, 0)),
    "RightShoulder": ("RightCollar", (-14, 0, 0)),
    "RightElbow": ("RightShoulder", (-28, 0, 0)),
    "RightWrist": ("RightElbow", (-25, 0, 0)),
    "LeftHip": ("Hips", (9, -8, 0)),
    "LeftKnee": ("LeftHip", (0, -41, 0)),
    "LeftAnkle": ("LeftKnee", (0, -40, 0)),
    "RightHip": ("Hips", (-9, -8, 0)),
    "RightKnee": ("RightHip", (0, -41, 0)),
    "RightAnkle": ("RightKnee", (0, -40, 0)),
}
MIXAMO = {
    "Chest": "Spine",
    "LeftCollar": "LeftShoulder",
    "LeftShoulder": "LeftArm",
    "LeftElbow": "LeftForeArm",
    "LeftWrist": "LeftHand",
    "LeftHip": "LeftUpLeg",
    "LeftKnee": "LeftLeg",
    "LeftAnkle": "LeftFoot",
}
MIXAMO |= {name.replace("Left", "Right"): other.replace("Left", "Right") for name, other in MIXAMO.items()}
BIPED = {
    "Hips": "Pelvis",
    "Chest": "Spine",
    "LeftCollar": "L Clavicle",
    "LeftShoulder": "L UpperArm",
    "LeftElbow": "L Forearm",
    "LeftWrist": "L Hand",
    "LeftHip": "L Thigh",
    "LeftKnee": "L Calf",
    "LeftAnkle": "L Foot",
}
BIPED |= {
    name.replace("Left", "Right"): other.replace("L ", "R ", 1)
    for name, other in BIPED.items()
    if "Left" in name
}
SPELLINGS = {
    "Biovision": lambda name: name,
    "BIOVISION": str.upper,
    "underscores": lambda name: re.sub("(?<=[a-z])(?=[A-Z])", "_", name).lower(),
    "Mixamo": lambda name: "mixamorig:" + MIXAMO.get(name, name),
    "Mixamo from Blender": lambda name: "mixamorig_" + MIXAMO.get(name, name),
    "biped": lambda name: "Bip01_" + BIPED.get(name, name).replace(" ", "_"),
}
SEGMENTS = {
    "Hips": "hips",
    "Neck": "neck",
    "Head": "head",
    "LeftShoulder": "lUpperArm",
    "LeftElbow": "lForearm",
    "LeftWrist": "lHand",
    "LeftHip": "lThigh",
    "LeftKnee": "lShin",
    "LeftAnkle": "lFoot",
}
SEGMENTS |= {
    name.replace("Left", "Right"): "r" + other[1:] for name, other in SEGMENTS.items() if "Left" in name
}


@pytest.mark.parametrize("kind", SPELLINGS)
def test_joints_are_known_however_they_are_spelt(kind):
    names = tuple(map(SPELLINGS[kind], BODY))
    joints = np.tile(np.arange(len(names))[:, None], (2, 1, 3)).astype(float)  # the number of the joint
    sites = read_sites(MODEL)
    motion = named_plainly(JointTrajectories("a", names, joints, 30.0), sites)
    found = {
        MODEL.names[sites[name].segment]: list(BODY)[int(k)]
        for name, k in zip(motion.joint_names, motion.joints[0, :, 0])
    }
    assert found == {segment: name for name, segment in SEGMENTS.items()}


def bvh_of(spell):
    """A person who bends arms and legs to and fro, in cm."""
    order, lines = [], ["HIERARCHY"]

    def joint(name, depth):
        order.append(name)
        parent, offset = BODY[name]
        lines.append(f"{'JOINT' if parent else 'ROOT'} {spell(name)} {{ OFFSET {' '.join(map(str, offset))}")
        places = "Xposition Yposition Zposition " if not parent else ""
        lines.append(f"CHANNELS {6 if not parent else 3} {places}Zrotation Xrotation Yrotation")
        children = [child for child, (above, _) in BODY.items() if above == name]
        for child in children:
            joint(child, depth + 1)
        lines.append("" if children else "End Site { OFFSET 0 5 0 }")
        lines.append("}")

    joint("Hips", 0)
    frames = []
    for k in range(40):
        row = [0.0, 95.0, 0.0]
        for number, _ in enumerate(order):
            row += [5.0 * np.sin(0.3 * k + number), 8.0 * np.cos(0.2 * k + number), 3.0 * np.sin(0.1 * k)]
        frames.append(" ".join(f"{value:.3f}" for value in row))
    return "\n".join([*lines, "MOTION", "Frames: 40", "Frame Time: 0.0333", *frames]) + "\n"


def test_a_prior_is_trained_on_motion_with_biovision_names(tmp_path, capsys):
    (tmp_path / "walk.bvh").write_text(bvh_of(str))
    assert main(["prior", "train", str(tmp_path / "walk.bvh"), "--out", str(tmp_path / "p.npz")]) == 0
    out = capsys.readouterr().out
    assert "40 poses, joints" in out or "poses, joints" in out
