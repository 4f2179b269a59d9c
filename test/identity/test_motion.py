"""The compiled filter against the numpy one, and what is predicted of people who are followed."""

import numpy as np
import pytest

from panoptic_ros.domain import TrackSet
from panoptic_ros.identity.motion import (
    ACCELERATION,
    FADE_TIME,
    FIRM_TIME,
    LOST_SIGMA,
    START_SPEED,
    JointMotion,
    predict,
    predicted,
    update_joints,
)
from test.support.motion_filter import predict_motion, update_motion

DT = 0.04
SECOND = 10**9


def motion_of(rng, people=4, joints=5):
    """Filters of people, a fifth of whose joints are unknown."""
    states = rng.normal(size=(people, joints, 6))
    states[rng.random((people, joints)) < 0.2] = np.nan
    variances = rng.uniform(1e-4, 0.2, (people, joints, 3)) * [1.0, 0.1, 1.0]
    ages = np.where(rng.random((people, joints)) < 0.5, 0.0, 0.1)
    return JointMotion(states, variances, ages, rng.random((people, joints)))


@pytest.mark.parametrize("seed", range(6))
def test_prediction_is_the_numpy_filters_and_forgets(seed):
    given = motion_of(np.random.default_rng(seed))
    got = JointMotion(*(table.copy() for table in given))
    predict(got, DT)
    states = given.states.copy()
    states[..., 3:] *= np.where(given.ages > 0.0, np.exp(-DT / FADE_TIME), 1.0)[..., None]
    states, variances = predict_motion(states, given.variances, DT, ACCELERATION)
    lost = variances[..., 0] > LOST_SIGMA**2
    assert lost.any() and not lost.all()
    states[lost] = np.nan
    for one, other in zip(got, (states, variances, given.ages + DT, given.unagreed + DT)):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("rate", [15.0, 30.0, 60.0])
def test_variances_grow_by_the_time_and_not_by_the_number_of_frames(rate):
    steps, whole = motion_of(np.random.default_rng(0)), motion_of(np.random.default_rng(0))
    for _ in range(round(0.2 * rate)):
        predict(steps, 1.0 / rate)
    predict(whole, 0.2)
    np.testing.assert_allclose(steps.variances, whole.variances, rtol=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_update_is_the_numpy_filters(seed):
    rng = np.random.default_rng(seed)
    given = motion_of(rng)
    got = JointMotion(*(table.copy() for table in given))
    positions = rng.normal(size=(5, 3))
    positions[rng.random(5) < 0.3] = np.nan
    covariances = rng.uniform(1e-5, 1e-3, (5, 1, 1)) * np.eye(3)
    views = rng.integers(0, 6, 5)
    update_joints(got, 2, positions, covariances, views, np.ones(5, np.uint8))
    noise = np.trace(covariances, axis1=-2, axis2=-1) / 3.0
    given.states[2], given.variances[2] = update_motion(
        given.states[2], given.variances[2], positions, noise, START_SPEED
    )
    given.ages[2] = np.where(np.isfinite(positions[:, 0]), 0.0, given.ages[2])
    given.unagreed[2] = np.where(views >= 3, 0.0, given.unagreed[2])
    for one, other in zip(got, given):
        np.testing.assert_array_equal(one, other)


def tracks(unseen=(0.0, 0.0), unagreed=0.0):
    """Two people who walk along x with 1.5 m/s, seen in the image of an instant."""
    states = np.zeros((2, 3, 6))
    states[..., 0], states[..., 3] = [[0.0], [2.0]], 1.5
    numbers = np.zeros((2, 3))
    return TrackSet(
        0,
        SECOND,
        "abc",
        np.array([0, -1]),
        states,
        np.full((2, 3, 3), 1e-4),
        numbers,
        numbers + unagreed,
        np.array(unseen),
    )


def test_people_are_predicted_where_they_walk_to():
    given = tracks()
    found = predicted(given, SECOND + 100_000_000, 0.5)
    assert np.abs(found.positions[:, :, 0] - [[0.15], [2.15]]).max() < 1e-12
    assert np.abs(found.velocities - [1.5, 0.0, 0.0]).max() < 1e-12
    assert np.array_equal(given.states[:, :, 0], [[0.0] * 3, [2.0] * 3])  # the record is left as it is


def test_who_was_not_seen_for_long_is_not_predicted():
    assert len(predicted(tracks((0.0, 0.45)), SECOND + 100_000_000, 0.5).positions) == 1
    assert len(predicted(tracks((0.0, 0.35)), SECOND + 100_000_000, 0.5).positions) == 2


def test_joints_are_firm_for_a_moment():
    early = predicted(tracks(), SECOND + round(0.9 * FIRM_TIME * SECOND), 0.5)
    late = predicted(tracks(), SECOND + round(1.1 * FIRM_TIME * SECOND), 0.5)
    assert early.firm.all() and not late.firm.any()
    assert not predicted(tracks(unagreed=np.inf), SECOND, 0.5).firm.any()


def test_filled_joints_are_what_the_filter_comes_to():
    """A joint that bones have placed is not a measurement: its variance is not divided once more."""
    motion = JointMotion.of_new(1, 2)
    exact = np.tile(1e-4 * np.eye(3), (2, 1, 1))
    update_joints(motion, 0, np.zeros((2, 3)), exact, np.full(2, 3), np.ones(2))
    predict(motion, 0.1)
    before = motion.variances[0, 0].copy()
    placed, spread = np.array([[0.0, 0.0, 0.05], [1.0, 1.0, 1.0]]), np.diag([1e-6, 1e-6, 0.5 * before[0]])
    update_joints(motion, 0, placed, np.stack([spread, spread]), np.ones(2), np.array([3, 1]))
    assert motion.states[0, 0, :3].tolist() == placed[0].tolist() and motion.ages[0, 0] == 0.0
    assert motion.variances[0, 0, 0] == pytest.approx(0.5 * before[0], rel=1e-6)  # of the least certain axis
    assert motion.states[0, 0, 5] == pytest.approx(0.05 * before[1] / before[0])
    assert 0.0 < motion.variances[0, 0, 2] < before[2]
    assert motion.variances[0, 1, 0] < 0.3 * motion.variances[0, 0, 0]  # the other one is a measurement
