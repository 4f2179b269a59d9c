"""Whose body a body is, and whether true joints lie where they are said to be."""

from dataclasses import replace

import numpy as np

from panoptic_ros.domain.subjects import BodyState
from panoptic_ros.running.studies.bodies.captures import inside, taken

RNG = np.random.default_rng(0)


def body(number, x, stamp=0):
    places = np.zeros((21, 3)) + [x, 0.0, 1.0]
    return BodyState(stamp, number, places, np.tile(np.eye(3), (21, 1, 1)))


def test_a_body_that_is_nearer_to_somebody_else_counts_as_taken():
    everybody = {0: [body(0, 0.0), body(100, 1.0)], 1: [body(0, 0.0, 1), body(100, 1.0, 1)]}
    assert taken([body(0, 0.4), body(0, 0.6, 1)], everybody) == 1
    assert taken([body(0, 0.6, 2)], everybody) == 0  # no truth then


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
