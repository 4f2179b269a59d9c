"""Whose body a body is."""

import numpy as np

from panoptic_ros.domain.subjects import BodyState
from panoptic_ros.study.bodies.captures import taken


def body(number, x, stamp=0):
    places = np.zeros((21, 3)) + [x, 0.0, 1.0]
    return BodyState(stamp, number, places, np.tile(np.eye(3), (21, 1, 1)))


def test_a_body_that_is_nearer_to_somebody_else_counts_as_taken():
    everybody = {0: [body(0, 0.0), body(100, 1.0)], 1: [body(0, 0.0, 1), body(100, 1.0, 1)]}
    assert taken([body(0, 0.4), body(0, 0.6, 1)], everybody) == 1
    assert taken([body(0, 0.6, 2)], everybody) == 0  # no truth then
