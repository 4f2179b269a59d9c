"""What all views see alike does not become surer with more of them."""

import numpy as np
from captures import RIG, SKELETON, person

from panoptic_ros.domain.subjects import Subject
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.io.pose_prior import read_prior
from panoptic_ros.kinematics.body.evidence import UNMEASURED_SD, Weighing
from panoptic_ros.kinematics.config import KinematicsConfig

BODY = read_body_model().body(1.7)
PLACE = np.array([0.0, 0.0, 1.0])
MEASURED = BODY.with_keypoints({name: (BODY.model.names[s], o) for name, (s, o) in BODY.keypoints.items()})


def information(body, views, level=1.0):
    """1/m^2, of the wrist from so many views."""
    names = SKELETON.joint_names
    weighing = Weighing(KinematicsConfig(), Subject(0, body), read_prior(), RIG, names)
    people = {}
    for number in range(views):
        pose = RIG.cameras[number].cam_from_world
        local = person((0.0, 0.0), 0.3) @ pose.rotation.T + pose.translation
        people[number] = (local[:, :2] / local[:, 2:], np.full(len(names), 0.9))
    targets = weighing.views(people, PLACE, level)
    depths = weighing.rotations[:, 2] @ PLACE + weighing.translations[:, 2]
    _, segments, offsets = weighing.sites
    site = next(k for k, c in enumerate(weighing.sites[0]) if names[c] == "lWrist")
    mine = (targets.segments == segments[site]) & (np.abs(targets.offsets - offsets[site]) < 1e-9).all(1)
    assert mine.sum() == views
    return float((targets.weights[mine] / depths[targets.cameras[mine]] ** 2).sum())


def test_a_measured_joint_is_as_sure_as_all_views_together():
    assert np.isclose(information(MEASURED, 4), 4 * information(MEASURED, 1))


def test_of_an_unmeasured_joint_an_error_that_all_views_share_stays():
    assert np.isclose(information(BODY, 1), information(MEASURED, 1))
    for level in (1.0, 0.25):
        alone = 1.0 / information(MEASURED, 1, level)
        variance = (alone - UNMEASURED_SD**2) / 4 + UNMEASURED_SD**2
        assert np.isclose(information(BODY, 4, level), 1.0 / variance)
