"""The level of errors of 2D joints, from joints whose errors are known."""

import numpy as np
import pytest
from bodies import BODY, cameras, placed, some_pose

from panoptic_ros.kinematics.body.noise_level import LEAST, MOST, NoiseLevel
from panoptic_ros.kinematics.pose.targets import ViewTargets

ASSUMED = 0.01  # on the plane


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
    assert noise.level == pytest.approx(min(max(1.05 * share, LEAST), MOST), rel=0.1)
