"""Lengths of somebody whose first skeletons are known exactly."""

import numpy as np
from bodies import MODEL

from panoptic_ros.geometry.chain import Pose, place_all
from panoptic_ros.kinematics.measured_body import ASKED, MeasuredBody

NAMES = tuple(MODEL.keypoints)
TRUNK = ("spine1", "spine2", "spine3", "spine4")


def somebody():
    """Broader in the shoulders, narrower in the hips, longer in the trunk than the stature tells."""
    body = MODEL.body(1.8)
    offsets = body.offsets.copy()
    for name, scale in (("UpperArm", [1.0, 1.15, 1.1]), ("Thigh", [1.0, 0.9, 1.1])):
        for side in "lr":
            offsets[MODEL.index(side + name)] *= scale
    for name in TRUNK:
        offsets[MODEL.index(name)] *= 1.1
    return body.with_offsets(dict(zip(MODEL.names, offsets)))


def skeleton(body, turn):
    turns = np.tile(np.eye(3), (len(MODEL.names), 1, 1))
    turns[0] = turn
    pose = Pose(np.array([0.5, 0.2, 1.0]), turns)
    places, frames = place_all(body.chain, pose.root[None], pose.turns[None])
    sites = [body.keypoints[name] for name in NAMES]
    return np.array([places[0, s] + frames[0, s] @ offset for s, offset in sites])


def test_limbs_and_trunk_are_measured():
    body, measured = somebody(), MeasuredBody()
    rng = np.random.default_rng(0)
    found = None
    for k in range(ASKED):
        assert found is None
        joints = skeleton(body, np.linalg.qr(rng.normal(size=(3, 3)))[0])
        joints[k] = np.nan  # never all of them
        found = measured.take(MODEL, NAMES, joints)
    told = [s for s in range(1, len(MODEL.names)) if MODEL.names[s][1:] not in ("ead", "eck", "Toe")]
    assert abs(found.offsets[told] - body.offsets[told])[:, 1:].max() < 0.01


def test_a_skeleton_of_few_joints_does_not_count():
    measured, joints = MeasuredBody(), np.full((len(NAMES), 3), np.nan)
    assert all(measured.take(MODEL, NAMES, joints) is None for _ in range(2 * ASKED))
