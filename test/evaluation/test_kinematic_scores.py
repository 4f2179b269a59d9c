"""Whether true joints lie where bodies say that they are."""

from dataclasses import replace

import numpy as np

from panoptic_ros.domain.subjects import BodyState
from panoptic_ros.evaluation.kinematic_scores import inside

RNG = np.random.default_rng(0)


def body(number, x, stamp=0):
    places = np.zeros((21, 3)) + [x, 0.0, 1.0]
    return BodyState(stamp, number, places, np.tile(np.eye(3), (21, 1, 1)))


def test_95_of_100_true_joints_lie_in_ellipsoids_of_the_true_spread():
    spread = np.array([0.01, 0.03, 0.1])
    truth = [body(0, 0.0, stamp) for stamp in range(200)]
    covariances = np.tile(np.diag(np.r_[spread, 1.0, 1.0, 1.0] ** 2), (21, 1, 1))
    found = [
        replace(state, places=state.places + spread * RNG.normal(size=(21, 3)), covariances=covariances)
        for state in truth
    ]
    assert abs(inside(found, truth) - 0.95) < 0.015
    assert np.isnan(inside(truth, truth))
