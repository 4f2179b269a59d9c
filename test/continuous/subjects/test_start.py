"""Poses along joints without jumps, with limbs that bend the way of their limits."""

import numpy as np
import pytest
from hinged_people import LEFT, NAMES, RIGHT, SKELETONS, freedoms

from panoptic_ros.continuous.subjects.start import bend_forward, poses_along

SKELETON = SKELETONS[0]
ELBOW, KNEE = LEFT + 3, LEFT + 7
TIMES = np.arange(0.0, 0.8, 0.02)


@pytest.mark.parametrize("bend", [ELBOW, KNEE, RIGHT + 3, RIGHT + 7])
@pytest.mark.parametrize("half", [-np.pi, np.pi])
def test_a_limb_that_bends_backward_is_turned_without_a_move_of_joints(bend, half):
    true = freedoms(TIMES)
    poses = true.copy()
    poses[:, bend] *= -1.0
    poses[:, bend - 1] += half
    joints = SKELETON.joints(poses)
    assert joints == pytest.approx(SKELETON.joints(true), abs=1e-9)
    bend_forward(SKELETON, poses)
    assert poses == pytest.approx(true)
    bend_forward(SKELETON, poses)
    assert poses == pytest.approx(true)


def test_poses_follow_joints_without_jumps_and_start_anew_after_a_gap():
    times = np.concatenate([TIMES, TIMES + 1.5])
    joints = SKELETON.joints(freedoms(times))
    joints[5:12, NAMES.index("lWrist")] = np.nan
    poses = poses_along(SKELETON, NAMES, joints, times)
    gaps = np.linalg.norm(SKELETON.joints(poses) - joints, axis=-1)
    assert np.nanmax(gaps) < 0.005
    steps = np.abs(np.diff(poses, axis=0))[:, 3:]
    steps[len(TIMES) - 1] = 0.0
    assert steps.max() < 0.4
    assert (
        poses[:, SKELETON.bends] * np.sign(np.mean(SKELETON.limits[list(SKELETON.bends)], axis=1)) > -0.1
    ).all()
