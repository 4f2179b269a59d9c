"""The skeleton of hinges, poses from joints, and lengths from joints."""

import captures
import hinged_people
import numpy as np
import pytest
from hinged_people import MODEL, NAMES, SKELETONS, freedoms

from panoptic_ros.continuous.elhayek.body import first_poses, skeleton_from, usable
from panoptic_ros.errors import DataError

TIMES = np.linspace(0.0, 3.0, 60)


def test_derivatives_are_those_of_differences():
    skeleton, at = SKELETONS[0], freedoms([0.7])
    _, slopes = skeleton.moved(at, skeleton.site_segments, skeleton.site_offsets)
    for d in range(skeleton.freedoms):
        way = np.zeros_like(at)
        way[0, d] = 1e-6
        differences = (skeleton.joints(at + way) - skeleton.joints(at - way)) / 2e-6
        assert slopes[..., d] == pytest.approx(differences, abs=1e-7)


def test_the_spine_shares_its_bend_and_every_freedom_moves_a_joint():
    skeleton = SKELETONS[0]
    spine = skeleton.mapping[:, 3:6]
    assert spine.sum(axis=0) == pytest.approx(1.0) and (spine > 0.0).sum(axis=0).tolist() == [4, 4, 4]
    _, slopes = skeleton.moved(freedoms([0.7]), skeleton.site_segments, skeleton.site_offsets)
    assert (np.abs(slopes).max(axis=(0, 1, 2)) > 0.01).all()


def test_poses_are_found_without_a_previous_pose():
    for person, skeleton in enumerate(SKELETONS):
        joints = skeleton.joints(freedoms(TIMES, person))
        gaps = skeleton.joints(first_poses(skeleton, NAMES, joints)) - joints
        assert np.linalg.norm(gaps, axis=-1).max() < 2e-3


def test_lengths_are_those_of_the_person():
    body = SKELETONS[1]
    joints = body.joints(freedoms(TIMES, 1)) + 0.005 * np.random.default_rng(0).standard_normal((60, 19, 3))
    found = skeleton_from(MODEL, NAMES, joints)
    for name in ("lForearm", "rHand", "lShin", "rFoot"):
        s = MODEL.index(name)
        assert np.linalg.norm(found.offsets[s]) == pytest.approx(np.linalg.norm(body.offsets[s]), abs=5e-3)


def test_instants_without_hips_or_with_few_joints_are_not_usable():
    joints = np.stack([captures.person((0.0, 0.0), 0.0)] * 3)
    joints[1, NAMES.index("lHip")] = np.nan
    joints[2, 8:] = np.nan
    assert usable(joints, NAMES).tolist() == [True, False, False]
    with pytest.raises(DataError, match="lacks rHip"):
        usable(joints[:, :18], [name for name in NAMES if name != "rHip"])


def test_limits_hold_in_the_motion_of_the_tests():
    for person, skeleton in enumerate(SKELETONS):
        angles = freedoms(TIMES, person)
        assert (angles > skeleton.limits[:, 0]).all() and (angles < skeleton.limits[:, 1]).all()
    assert hinged_people.SKELETONS[0].freedoms == 28
