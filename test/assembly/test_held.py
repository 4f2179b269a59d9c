"""People whom one or two views show, held by their bones."""
import numpy as np
import pytest

from panoptic_ros.assembly.body_estimate import GROWTH, Body, Known, Rays, estimate
from panoptic_ros.assembly.held import upwards
from panoptic_ros.domain import SkeletonModel
from panoptic_ros.simulation.rigs import looking_at

MODEL = SkeletonModel("chain", ("root", "left", "right", "top"), 0, ((0, 1), (0, 2), (0, 3)), 3, ((1, 2),))
BODY = Body.of(MODEL)
TRUTH = np.array([[0.0, 0.0, 1.0], [0.0, 0.3, 1.0], [0.0, -0.3, 1.0], [0.0, 0.0, 1.6]])
UP = np.array([0.0, 0.0, 1.0])
LENGTHS = np.array([0.3, 0.3, 0.6])
POSE = looking_at(np.array([4.0, 0.0, 2.0]), np.array([0.0, 0.0, 1.0]))


def known(places, sigma=0.3, slack=0.02, rise=10.0, bone=0.005):
    """What is known of somebody predicted at these places, with this standard deviation m."""
    vectors = places[BODY.bones[:, 1]] - places[BODY.bones[:, 0]]
    information = np.tile(np.eye(3) / sigma**2, (4, 1, 1))
    return Known(places, information, vectors, np.full(3, slack), LENGTHS, bone, TRUTH, UP, rise)


def rays(joints, precision=500.0):
    """One view of the true joints."""
    seen = TRUTH[joints] @ POSE.rotation.T + POSE.translation
    count = len(joints)
    return Rays(
        np.array(joints), seen[:, :2] / seen[:, 2:], np.full(count, precision),
        np.tile(POSE.rotation, (count, 1, 1)), np.tile(POSE.translation, (count, 1)),
    )  # fmt: skip


def test_bones_tell_the_depth_of_what_one_view_shows():
    moved = TRUTH + [0.25, 0.0, 0.0]  # nearly along the rays
    places, covariances, residuals = estimate(known(moved), rays([0, 1, 2, 3]), BODY)
    assert np.linalg.norm(places - TRUTH, axis=-1).max() < 0.08 and residuals.max() < 1.0
    loose = known(moved, slack=0.3)._replace(lengths=np.full(3, np.nan))
    without, wider, _ = estimate(loose, rays([0, 1, 2, 3]), BODY)
    assert np.linalg.norm(without - TRUTH, axis=-1).mean() > 0.15
    assert np.trace(wider[0]) > np.trace(covariances[0])


def test_that_people_do_not_rise_tells_depth_too():
    moved = TRUTH + [0.25, 0.0, 0.0]
    loose = known(moved)._replace(lengths=np.full(3, np.nan))
    places, _, _ = estimate(loose._replace(rise=0.005), rays([0, 1, 2, 3]), BODY)
    assert np.linalg.norm(places - TRUTH, axis=-1).max() < 0.08


def test_parts_that_nobody_sees_go_with_the_body_and_become_less_certain():
    aside = TRUTH + [0.0, 0.2, 0.0]
    guess = known(aside)
    guess.information[2] *= 1e-4  # nobody sees it
    places, covariances, _ = estimate(guess, rays([0, 1, 3]), BODY)
    assert np.abs(places[2] - TRUTH[2])[1] < 0.05
    assert np.trace(covariances[2]) > np.trace(covariances[1])


def test_covariances_are_of_the_normal_matrix_and_unknown_joints_stay_so():
    guess = known(TRUTH.copy())
    guess.places[3] = np.nan
    nothing = Rays(*(part[:0] for part in rays([0])))
    free = guess._replace(lengths=np.full(3, np.nan), slack=np.full(3, 1e3), rise=1e3)
    places, covariances, _ = estimate(free, nothing, BODY)
    assert np.isnan(places[3]).all() and np.isnan(covariances[3]).all()
    assert covariances[1] == pytest.approx(GROWTH * 0.09 * np.eye(3), rel=1e-3, abs=1e-5)


def test_cameras_tell_which_way_is_up():
    ring = [np.array([3.0 * np.cos(a), 3.0 * np.sin(a), 2.5]) for a in np.arange(0.0, 6.0, 1.2)]
    poses = np.stack([looking_at(place, np.array([0.0, 0.0, 1.0])).rotation for place in ring])
    assert upwards(poses) == pytest.approx(UP, abs=1e-3)
    assert upwards(poses[:2]) == pytest.approx(UP, abs=0.1)
    turn = looking_at(np.array([1.0, 2.0, 3.0]), np.zeros(3)).rotation
    assert upwards(poses @ turn.T) == pytest.approx(turn @ upwards(poses))  # whatever the world's axes are
