"""Covariances of segments against the derivatives of their places and rotations."""

import numpy as np
import pytest
from bodies import CHAIN, MODEL, D, S, some_pose

from panoptic_ros.geometry.chain import place_sites, turn_slopes
from panoptic_ros.kinematics.pose.covariance import segment_covariances


def test_covariances_are_those_of_the_derivatives():
    pose, rng = some_pose(3), np.random.default_rng(4)
    spread = rng.normal(size=(D, D))
    covariance = spread @ spread.T + np.eye(D)
    slopes = np.empty((S, 6, D))
    own, turns = np.empty((S, 3, D)), np.empty((S, 3, D))
    place_sites(CHAIN, pose, np.arange(S), np.zeros((S, 3)), own)
    turn_slopes(CHAIN, pose, np.arange(S), turns)
    slopes[:, :3], slopes[:, 3:] = own, turns
    expected = slopes @ covariance @ slopes.swapaxes(1, 2)
    found = segment_covariances(CHAIN, pose, covariance)
    np.testing.assert_allclose(found, expected, atol=1e-6 * abs(expected).max())


def test_joint_names_are_those_of_rep_155():
    names = MODEL.joint_names
    assert len(names) == len(set(names)) == D - 6
    assert {"l_y_shoulder", "r_p_hip", "l_p_knee", "p_head", "r_y_elbow"} <= set(names)


def test_a_bent_knee_is_one_angle():
    frames = np.tile(np.eye(3), (S, 1, 1))
    for name in ("lShin", "lFoot", "lToe"):
        frames[MODEL.index(name)] = [[np.cos(1), 0, np.sin(1)], [0, 1, 0], [-np.sin(1), 0, np.cos(1)]]
    angles = dict(zip(MODEL.joint_names, MODEL.joint_angles(frames)))
    assert angles.pop("l_p_knee") == pytest.approx(1.0)
    np.testing.assert_allclose(list(angles.values()), 0.0, atol=1e-9)
