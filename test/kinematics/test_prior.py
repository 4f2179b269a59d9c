"""Distances from the space of recorded poses."""

import numpy as np

from panoptic_ros.kinematics.prior import PoseStatistics

RNG = np.random.default_rng(0)
COMPONENTS = np.linalg.qr(RNG.normal(size=(9, 4)))[0]
PRIOR = PoseStatistics(RNG.normal(size=9), COMPONENTS, np.array([1.0, 0.7, 0.5, 0.2]), np.full(9, 0.3))


def test_equal_spreads_give_the_plain_distance_in_spreads():
    projection, deviation = PRIOR.measured_in(np.full(9, 0.2))
    np.testing.assert_allclose(projection, PRIOR.projection / 0.04, atol=1e-12)
    np.testing.assert_allclose(deviation, PRIOR.deviation, atol=1e-12)


def test_the_nearest_point_of_the_space_is_that_of_least_squares():
    spreads, apart = RNG.uniform(0.05, 0.5, 9), RNG.normal(size=9)
    projection, deviation = PRIOR.measured_in(spreads)
    along, rest, *_ = np.linalg.lstsq(COMPONENTS / spreads[:, None], apart / spreads, rcond=None)
    assert np.isclose(apart @ projection @ apart, rest[0])
    assert np.isclose(apart @ deviation @ apart, ((along / PRIOR.deviations) ** 2).sum())


def test_axes_that_hardly_vary_are_held_and_those_that_can_turn_far_are_not():
    prior = PoseStatistics(np.zeros(3), np.eye(3)[:, :1], np.ones(1), np.radians([30.0, 0.0, 0.0]))
    lower, upper = np.radians([[0, 0, 0], [-90, -10, -100]]), np.radians([[0, 0, 0], [90, 10, 100]])
    off = np.degrees(prior.off_space(lower, upper, np.radians(12.0)))
    np.testing.assert_allclose(off, [11.33, 2.0, 12.0], atol=0.02)
