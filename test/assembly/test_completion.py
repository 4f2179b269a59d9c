"""People keep joints that two views dispute or only one sees; tracked people keep them in all views."""

from functools import partial

import numpy as np
import pytest
from fed_stages import FedAssembly

from panoptic_ros.assembly.completion import upwards
from panoptic_ros.domain import JointState
from panoptic_ros.simulation.rigs import looking_at

UP = np.array([0.0, 0.0, 1.0])


ELBOW_LOST = 14  # frame from which only one of three views sees the elbow, of a body whose bones are known


def solve(scenes, views, change, frames=8):
    rig, person = scenes.ring(3), scenes.person(0.2, 0.1)
    rig = rig.subset(rig.names[:views])
    stage = FedAssembly(scenes.context(rig))
    for index in range(frames):
        changed = partial(change, index) if frames > ELBOW_LOST else change
        pose = stage.step(scenes.proposals(rig, [person], index=index, noise=1.0, change=changed)).outputs[0]
    return pose, np.linalg.norm(pose.positions[0] - person, axis=-1)


def test_two_views_lose_no_joint_to_a_miss_or_a_mistake(scenes):
    missed, wrong = scenes.skeleton.joint("rElbow"), scenes.skeleton.joint("lShoulder")

    def change(i, points, scores):
        if i == 0:
            points[:, missed], scores[:, missed] = np.nan, 0.0
            points[:, wrong, 1] += 30.0

    pose, errors = solve(scenes, 2, change)
    assert errors[missed] < 0.2 and pose.views[0, missed] == 1
    assert errors[wrong] < 0.1 and pose.views[0, wrong] == 2
    sigma = np.sqrt(np.trace(pose.covariances[0], axis1=1, axis2=2) / 3.0)
    others = np.delete(np.arange(len(errors)), [missed, wrong])
    assert sigma[[missed, wrong]].min() > 2.0 * np.median(sigma[others])
    assert (errors < 6.0 * sigma).all()


def test_three_views_leave_out_what_they_cannot_tell(scenes):
    missed = scenes.skeleton.joint("rElbow")

    def change(i, points, scores):
        if i < 2:
            points[:, missed], scores[:, missed] = np.nan, 0.0

    pose, _ = solve(scenes, 3, change)
    assert pose.views[0, missed] == 0 and np.isnan(pose.positions[0, missed]).all()


def test_a_tracked_person_of_many_views_keeps_a_joint_that_one_view_sees(scenes):
    missed = scenes.skeleton.joint("rElbow")

    def change(index, i, points, scores):
        if i < 2 and index >= ELBOW_LOST:
            points[:, missed], scores[:, missed] = np.nan, 0.0

    pose, errors = solve(scenes, 3, change, ELBOW_LOST + 3)
    sigma = np.sqrt(np.trace(pose.covariances[0, missed]) / 3.0)
    assert errors[missed] < min(0.05, 3.0 * sigma)
    assert pose.states[0, missed] == JointState.FILLED and pose.views[0, missed] == 1


def test_cameras_tell_which_way_is_up():
    ring = [np.array([3.0 * np.cos(a), 3.0 * np.sin(a), 2.5]) for a in np.arange(0.0, 6.0, 1.2)]
    poses = np.stack([looking_at(place, np.array([0.0, 0.0, 1.0])).rotation for place in ring])
    assert upwards(poses) == pytest.approx(UP, abs=1e-3)
    assert upwards(poses[:2]) == pytest.approx(UP, abs=0.1)
    turn = looking_at(np.array([1.0, 2.0, 3.0]), np.zeros(3)).rotation
    assert upwards(poses @ turn.T) == pytest.approx(turn @ upwards(poses))  # whatever the world's axes are
