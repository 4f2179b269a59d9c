"""Lengths of somebody whose skeletons are known exactly."""

from dataclasses import replace

import numpy as np
import pytest
from bodies import MODEL

from panoptic_ros.domain.segments import JointOffset
from panoptic_ros.geometry.chain import Pose, place_all
from panoptic_ros.geometry.rotations import rotations_of
from panoptic_ros.io.pose_prior import read_prior
from panoptic_ros.io.recorded_motions import read_clips
from panoptic_ros.kinematics.body.measured_body import MOST, MeasuredBody
from panoptic_ros.kinematics.config import KinematicsConfig

NAMES = tuple(MODEL.keypoints)
TRUNK = ("spine1", "spine2", "spine3", "spine4")
HIGH = MODEL.with_joint_offsets(
    {
        f"{side}{joint}": JointOffset(frame if frame == "spine4" else side + frame, (x, factor * y, z))
        for side, factor in (("l", 1.0), ("r", -1.0))
        for joint, frame, (x, y, z) in (
            ("Shoulder", "spine4", (0, 0, 0.04)),
            ("Hip", "Thigh", (0.03, 0.02, 0)),
        )
    }
)


def somebody(model):
    """Broader in the shoulders, narrower in the hips, longer in the trunk than the stature tells."""
    body = model.body(1.8)
    offsets = body.offsets.copy()
    for name, scale in (("UpperArm", [1.0, 1.1, 1.1]), ("Thigh", [1.0, 0.9, 1.1])):
        for side in "lr":
            offsets[model.index(side + name)] *= scale
    for name in TRUNK:
        offsets[model.index(name)] *= 1.1
    return body.with_offsets(dict(zip(model.names, offsets)))


def skeletons(body):
    """As a detector sees them that is off as the model says."""
    clip = read_clips()["02_05"]
    found = []
    for vectors in clip.vectors[:: len(clip.vectors) // MOST][:MOST]:
        pose = Pose(np.array([0.5, 0.2, 1.0]), rotations_of(np.ascontiguousarray(vectors)))
        places, frames = place_all(body.chain, pose.root[None], pose.turns[None])
        sites = [body.seen[name] for name in NAMES]
        found.append([places[0, s] + frames[0, s] @ offset for s, offset in sites])
    return np.array(found)


def taken(model, joints):
    """What comes of each skeleton."""
    measured, config, statistics = MeasuredBody(), KinematicsConfig(), read_prior("")
    sure = np.tile(0.02**2 * np.eye(3), (len(NAMES), 1, 1))
    return [measured.take(config, model, statistics, NAMES, (positions, sure)) for positions in joints]


@pytest.mark.parametrize("model", [MODEL, HIGH], ids=["as it is", "seen elsewhere"])
def test_limbs_and_trunk_are_measured(model):
    body = somebody(model)
    joints = skeletons(body)
    joints[range(MOST), range(MOST)] = np.nan  # never all of them
    found = taken(model, joints)[-1]
    limbs = [model.index(side + name) for side in "lr" for name in ("Forearm", "Hand", "Shin", "Foot")]
    assert abs(found.offsets[limbs] - body.offsets[limbs]).max() < 0.005
    told = [model.index(name) for name in ("lUpperArm", "lThigh")]
    assert abs(found.offsets[told] - body.offsets[told])[:, 1].max() < 0.01
    trunk = [model.index(name) for name in (*TRUNK, "lUpperArm")]
    assert abs((found.offsets[trunk] - body.offsets[trunk])[:, 2].sum()) < 0.02


def test_what_the_detector_is_off_is_no_length():
    """A body that does not know of it takes it for lengths."""
    joints = skeletons(somebody(HIGH))
    found = [taken(model, joints)[-1].offsets for model in (MODEL, HIGH)]
    hip = MODEL.index("lThigh")
    true = somebody(HIGH).offsets[hip, 1]
    assert abs(found[1][hip, 1] - true) < 0.5 * abs(found[0][hip, 1] - true)


def test_what_was_measured_on_a_person_counts_more():
    body = HIGH.body(1.8)
    own = body.with_keypoints({"lHip": ("lThigh", np.array([0.0, 0.0, 0.01]))})
    assert own.seen["lHip"][1][2] == 0.01 and own.seen["rHip"][1][0] == 0.03
    shoulder, at = own.seen["lShoulder"]
    assert MODEL.names[shoulder] == "spine4"
    assert np.allclose(at, body.offsets[MODEL.index("lUpperArm")] + [0.0, 0.0, 0.04])
    assert replace(own, own=frozenset()).seen["lHip"][1][0] == 0.03


def test_a_skeleton_of_few_joints_does_not_count():
    assert taken(MODEL, np.full((2 * MOST, len(NAMES), 3), np.nan)) == [None] * (2 * MOST)


def test_the_first_skeleton_tells_a_body_and_twice_as_many_tell_it_better():
    body, errors = somebody(MODEL), []
    for seed in range(3):
        noise = np.random.default_rng(seed).normal(0.0, 0.02, (MOST, len(NAMES), 3))
        found = taken(MODEL, skeletons(body) + noise)
        known = [k + 1 for k, told in enumerate(found) if told is not None]
        assert known == [1, 2, 4, 8, 16]
        told = [found[k - 1].offsets for k in known]
        errors.append(np.linalg.norm(told - body.offsets, axis=-1).mean(axis=-1))
    assert np.mean(errors, axis=0)[-1] < 0.8 * np.mean(errors, axis=0)[0]


def test_skeletons_of_long_ago_count_as_much_as_new_ones():
    """Somebody who seems to be short for a while, and for as long tall."""
    joints = skeletons(MODEL.body(1.8))
    centre = joints.mean(axis=1, keepdims=True)
    short, tall = centre + 0.9 * (joints - centre), centre + 1.1 * (joints - centre)
    both = np.concatenate([np.tile(own, (4, 1, 1)) for own in (short, tall)])
    low, middle, high = (
        np.linalg.norm(taken(MODEL, own)[-1].offsets, axis=-1).sum() for own in (short, both, tall)
    )
    assert abs(middle - 0.5 * (low + high)) < 0.2 * (high - low)
