"""Distances from the space of recorded poses."""

import numpy as np
import pytest
from bodies import CHAIN, MODEL, D, S, no_prior

from panoptic_ros.errors import DataError
from panoptic_ros.geometry.chain import Pose
from panoptic_ros.geometry.rotations import rotations_of
from panoptic_ros.kinematics.pose.normal_equations import assemble
from panoptic_ros.kinematics.pose.prior import PoseStatistics, hinges_of
from panoptic_ros.kinematics.pose.targets import (
    NO_FLOOR,
    NO_POINTS,
    NO_TURNS,
    NO_VIEWS,
    PoseEvidence,
    no_anchor,
)

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


def hinge_cost(bend, aside, turn):
    """Of a left elbow that bends, leaves its plane by an angle and turns about the forearm, rad."""
    pose = Pose(np.zeros(3), np.tile(np.eye(3), (S, 1, 1)))
    axes = np.array([[0, 0, bend], [aside, 0, 0], [0, turn, 0]])
    pose.turns[MODEL.index("lForearm")] = np.linalg.multi_dot(rotations_of(axes))
    prior = no_prior(S)._replace(hinges=hinges_of(MODEL, 0.1))
    evidence = PoseEvidence(NO_VIEWS, NO_POINTS, NO_TURNS, NO_FLOOR, prior, 1.0)
    return assemble(CHAIN, pose, evidence, no_anchor(S), np.empty((D, D)), np.empty(D))


def test_an_elbow_bends_and_a_forearm_turns_at_no_cost():
    assert hinge_cost(-1.5, 0.0, 0.8) < 1e-12


def test_an_elbow_that_leaves_its_plane_costs_its_sine_in_spreads():
    assert np.isclose(hinge_cost(-1.5, 0.2, 0.8), (np.sin(0.2) / 0.1) ** 2)


def test_bones_of_hinges_lead_to_the_next_joint():
    hinges = hinges_of(MODEL, 0.1)
    found = {MODEL.names[s]: bone.tolist() for s, bone in zip(hinges.segments, hinges.bones)}
    assert found == {"lForearm": [0, 1, 0], "rForearm": [0, -1, 0], "lShin": [0, 0, -1], "rShin": [0, 0, -1]}


NAMES = ("hips", "spine", "lThigh", "rThigh")


def covariance(statistics):
    scaled = statistics.components * statistics.deviations
    return scaled @ scaled.T


def test_statistics_of_a_skeleton_with_fewer_segments_are_those_of_what_is_left():
    found = PRIOR.of_other_segments(NAMES, ("hips", "rThigh", "spine"))
    rows = [6, 7, 8, 0, 1, 2]
    np.testing.assert_allclose(found.mean, PRIOR.mean[rows])
    np.testing.assert_allclose(covariance(found), covariance(PRIOR)[np.ix_(rows, rows)], atol=2e-3)
    assert PRIOR.of_other_segments(NAMES, NAMES) is PRIOR


def test_segments_that_nothing_is_known_of_may_turn_about_the_t_posture():
    found = PRIOR.of_other_segments(NAMES, ("hips", "tail", "spine"))
    np.testing.assert_allclose(found.mean, np.r_[np.zeros(3), PRIOR.mean[:3]])
    np.testing.assert_allclose(found.projection[:3, :3], np.eye(3), atol=1e-12)
    np.testing.assert_allclose(covariance(found)[:3], 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("own", "names", "told"),
    [
        (NAMES[:3], NAMES, "9 axes are not of 3 segments"),
        (NAMES, ("hips", "tail"), "none of its segments"),
    ],
)
def test_statistics_of_nothing_alike_are_refused(own, names, told):
    with pytest.raises(DataError, match=told):
        PRIOR.of_other_segments(own, names)
