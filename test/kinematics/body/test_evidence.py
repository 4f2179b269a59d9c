"""What all views see alike does not become surer with more of them.

The level of errors of 2D joints, from joints whose errors are known.
"""

import numpy as np
import pytest
from bodies import BODY, cameras, placed, some_pose
from captures import RIG, SKELETON, person

from panoptic_ros.domain.subjects import Subject
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.io.pose_prior import read_prior
from panoptic_ros.kinematics.body.evidence import (
    LEAST_LEVEL,
    MOST_LEVEL,
    UNMEASURED_SD,
    EvidenceBuilder,
    NoiseLevel,
)
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.pose.targets import ViewTargets

TALL = read_body_model().body(1.7)
PLACE = np.array([0.0, 0.0, 1.0])
MEASURED = TALL.with_keypoints({name: (TALL.model.names[s], o) for name, (s, o) in TALL.keypoints.items()})
ASSUMED = 0.01  # on the plane


def information(body, views, level=1.0):
    """1/m^2, of the wrist from so many views."""
    names = SKELETON.joint_names
    weighing = EvidenceBuilder(KinematicsConfig(), Subject(0, body), read_prior(), RIG, names)
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
    assert np.isclose(information(TALL, 1), information(MEASURED, 1))
    for level in (1.0, 0.25):
        alone = 1.0 / information(MEASURED, 1, level)
        variance = (alone - UNMEASURED_SD**2) / 4 + UNMEASURED_SD**2
        assert np.isclose(information(TALL, 4, level), 1.0 / variance)


@pytest.mark.parametrize("share", [0.1, 0.5, 2.5, 6.0])
def test_the_level_is_that_of_the_errors_within_bounds(share):
    rng, pose = np.random.default_rng(0), some_pose()
    _, places = placed(pose)
    (rotations, translations), count = cameras(4), len(places)
    views, segments = np.repeat(np.arange(4), count), np.tile(np.arange(count), 4)
    local = (rotations[views] @ places[segments][..., None])[..., 0] + translations[views]
    exact, noise = local[:, :2] / local[:, 2:], NoiseLevel()
    for _ in range(60):
        points = exact + rng.normal(0.0, share * ASSUMED, exact.shape)
        points[::9] += 5.0  # outliers
        weights = np.full(len(points), (noise.level * ASSUMED) ** -2)
        offsets = np.zeros((len(points), 3))
        targets = ViewTargets(segments, offsets, views, points, weights, 0.0, rotations, translations)
        noise.learn(targets, BODY.chain, pose, 0.1)
    assert noise.level == pytest.approx(min(max(1.05 * share, LEAST_LEVEL), MOST_LEVEL), rel=0.1)
