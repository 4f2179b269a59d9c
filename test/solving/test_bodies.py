"""Bodies whom one or two views show, from their bones."""

import numpy as np
import pytest
from seen_views import observations

from panoptic_ros.domain import SkeletonModel
from panoptic_ros.simulation.rigs import looking_at
from panoptic_ros.solving.bodies import PersonPrior, PersonRays, SkeletonArrays, begin, estimate
from panoptic_ros.solving.scene import CameraPoses

MODEL = SkeletonModel("chain", ("root", "left", "right", "top"), 0, ((0, 1), (0, 2), (0, 3)), 3, ((1, 2),))
BODY, ALL = SkeletonArrays.of(MODEL), np.ones(4, bool)
TRUTH = np.array([[0.0, 0.0, 1.0], [0.0, 0.3, 1.0], [0.0, -0.3, 1.0], [0.0, 0.0, 1.6]])
UP = np.array([0.0, 0.0, 1.0])
LENGTHS = np.array([0.3, 0.3, 0.6])
PLACES = np.array([[4.0, 0.0, 2.0], [0.5, 4.0, 2.0]])
NOTHING = np.full((4, 3), np.nan)


def known(places, sigma=0.3, slack=0.02, rise=10.0, bone=0.005):
    """What is known of somebody predicted at these places, with this standard deviation m."""
    vectors = places[BODY.bones[:, 1]] - places[BODY.bones[:, 0]]
    information = np.tile(np.eye(3) / sigma**2, (4, 1, 1))
    slacks, spreads = np.full(3, slack), np.full(3, bone)
    return PersonPrior(places, information, vectors, slacks, LENGTHS.copy(), spreads, TRUTH.copy(), UP, rise)


def solved(joints, lengths):
    """Of somebody of whom two views have solved these joints, and bones of these lengths are known."""
    places, information = NOTHING.copy(), np.zeros((4, 3, 3))
    places[joints], information[joints] = TRUTH[joints], 1e4 * np.eye(3)
    return PersonPrior(
        places,
        information,
        np.zeros((3, 3)),
        np.full(3, np.inf),
        np.array(lengths),
        np.full(3, 0.05),
        np.zeros((4, 3)),
        np.zeros(3),
        np.inf,
    )


def rays(*joints, precision=500.0, places=TRUTH):
    """What each view shows of the true joints; a view for each list of joints."""
    poses = [looking_at(place, UP) for place in PLACES[: len(joints)]]
    seen = np.stack([places @ pose.rotation.T + pose.translation for pose in poses])
    shown = np.zeros((len(poses), 4))
    for row, own in zip(shown, joints):
        row[own] = precision
    views = np.arange(len(poses))
    cams = CameraPoses(
        np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses]), np.zeros(len(poses))
    )
    shown_joints = observations(seen[..., :2] / seen[..., 2:], shown, views, np.arange(len(poses) + 1), cams)
    return PersonRays(
        views, np.tile(np.arange(4), (len(poses), 1)), np.zeros((4, 3)), np.ones(4), shown_joints
    )


def test_bones_tell_the_depth_of_what_one_view_shows():
    moved = TRUTH + [0.25, 0.0, 0.0]  # nearly along the rays
    places, covariances, residuals = estimate(known(moved), rays([0, 1, 2, 3]), BODY, ALL)
    assert np.linalg.norm(places - TRUTH, axis=-1).max() < 0.08 and residuals.max() < 1.0
    loose = known(moved, slack=0.3)._replace(lengths=np.full(3, np.nan))
    without, wider, _ = estimate(loose, rays([0, 1, 2, 3]), BODY, ALL)
    assert np.linalg.norm(without - TRUTH, axis=-1).mean() > 0.15
    assert np.trace(wider[0]) > np.trace(covariances[0])


def test_that_people_do_not_rise_tells_depth_too():
    moved = TRUTH + [0.25, 0.0, 0.0]
    loose = known(moved)._replace(lengths=np.full(3, np.nan))
    places, _, _ = estimate(loose._replace(rise=0.005), rays([0, 1, 2, 3]), BODY, ALL)
    assert np.linalg.norm(places - TRUTH, axis=-1).max() < 0.08


def test_parts_that_nobody_sees_go_with_the_body_and_become_less_certain():
    guess = known(TRUTH + [0.0, 0.2, 0.0])
    guess.information[2] *= 1e-4  # nobody sees it
    places, covariances, _ = estimate(guess, rays([0, 1, 3]), BODY, ALL)
    assert np.abs(places[2] - TRUTH[2])[1] < 0.05
    assert np.trace(covariances[2]) > np.trace(covariances[1])


def test_covariances_are_of_the_normal_matrix_and_unknown_joints_stay_so():
    guess = known(TRUTH.copy())
    guess.places[3] = np.nan
    free = guess._replace(lengths=np.full(3, np.nan), slack=np.full(3, 1e3), rise=1e3)
    places, covariances, residuals = estimate(free, rays([]), BODY, ALL)
    assert np.isnan(places[3]).all() and np.isnan(covariances[3]).all() and np.isnan(residuals).all()
    assert covariances[1] == pytest.approx(0.09 * np.eye(3), rel=1e-3, abs=1e-5)


def test_two_rays_that_pass_each_other_meet_in_the_middle_with_their_gap_as_noise():
    apart, guess = rays([0, 1, 2, 3], [0, 1, 2, 3]), solved([0, 1, 2], [np.nan] * 3)
    apart.seen.plane[1, 3, 1] -= 0.02  # 8 cm higher
    begin(guess, apart, BODY, NOTHING)
    places, covariances, residuals = estimate(guess, apart, BODY, ALL)
    assert np.abs(places[3] - TRUTH[3]).max() < 0.06 and 0.02 < places[3, 2] - TRUTH[3, 2] < 0.06
    assert covariances[3, 2, 2] > 0.02**2 > 10.0 * covariances[0, 2, 2] and residuals[:, 3].max() < 1.1
    far, guess = rays([0, 1, 2, 3], [0, 1, 2, 3]), solved([0, 1, 2], [np.nan] * 3)
    far.seen.plane[1, 3, 1] -= 0.1
    begin(guess, far, BODY, NOTHING)
    assert np.isnan(guess.places[3]).all()


def test_on_a_ray_where_the_bone_is_as_long_as_that_of_the_other_side():
    turned = TRUTH + [[0.0] * 3, [0.15, -0.05, 0.0], [0.0] * 3, [0.0] * 3]  # towards the camera, and nearer
    seen = rays([1], places=turned)
    for expected, near in ((turned[1], 0.06), (TRUTH[1] - [0.15, 0.05, 0.0], None), (NOTHING[1], None)):
        guess, hoped = solved([0, 2], [0.3, np.nan, np.nan]), NOTHING.copy()
        hoped[1] = expected
        begin(guess, seen, BODY, hoped)
        places, covariances, _ = estimate(guess, seen, BODY, ALL)
        assert covariances[1, 0, 0] > 5.0 * covariances[1, 1, 1]  # along the ray
        if near is not None:
            assert np.abs(places[1] - turned[1]).max() < near
    beside = solved([0], [np.nan] * 3)
    begin(beside, rays([3], places=TRUTH), BODY, NOTHING)
    assert np.isnan(beside.places[3]).all()  # a head is not so far from the body
