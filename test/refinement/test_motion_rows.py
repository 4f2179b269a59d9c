"""Measurements of position and velocity together against the textbook's matrices."""
import numpy as np

from panoptic_ros.refinement.kalman import update
from panoptic_ros.refinement.motion_rows import started, update_moving, update_velocities
from panoptic_ros.refinement.records import Motion

FOREVER = 1e9  # Cauchy scale: plain Gaussian
FIRST = np.array([0])  # row of the only person


def positive(rng, size, scale):
    factor = scale * rng.standard_normal((size, size))
    return factor @ factor.T + 1e-3 * scale**2 * np.eye(size)


def updated(state, covariance, matrix, value, noise):
    gain = covariance @ matrix.T @ np.linalg.inv(matrix @ covariance @ matrix.T + noise)
    return state + gain @ (value - matrix @ state), covariance - gain @ matrix @ covariance


def one(array):
    """Of the only joint of the only person."""
    return array[None, None].copy()


def scene(seed):
    rng = np.random.default_rng(seed)
    return (
        rng, rng.standard_normal(6), positive(rng, 6, 0.3), rng.standard_normal(3), positive(rng, 3, 0.1),
        0.02 * rng.standard_normal((3, 3)),
    )  # fmt: skip


def test_a_position_in_motion_is_one_measurement():
    _, state, covariance, point, noise, delays = scene(0)
    motion = Motion(one(state), one(covariance))
    update_moving(motion, FIRST, one(point), one(noise), one(delays), FOREVER, np.empty((1, 1, 3)))
    expected = updated(state, covariance, np.hstack([np.eye(3), delays]), point, noise)
    assert np.allclose(motion.states, expected[0]) and np.allclose(motion.covariances, expected[1])


def test_without_delays_it_is_a_position():
    _, state, covariance, point, noise, delays = scene(1)
    still, moving = (Motion(one(state), one(covariance)) for _ in range(2))
    update(still, FIRST, one(point), one(noise), 3.0, np.empty((1, 1, 3)))
    update_moving(moving, FIRST, one(point), one(noise), one(0.0 * delays), 3.0, np.empty((1, 1, 3)))
    assert np.allclose(still.states, moving.states) and np.allclose(still.covariances, moving.covariances)


def test_a_new_point_starts_as_if_its_position_had_been_unknown():
    rng, _, _, point, noise, delays = scene(2)
    velocity, spread = rng.standard_normal(3), positive(rng, 3, 1.5)
    motion = started(point[None], noise[None], delays[None], velocity[None], spread[None])
    prior = np.zeros((6, 6))
    prior[:3, :3], prior[3:, 3:] = 1e8 * np.eye(3), spread
    start = np.concatenate([np.zeros(3), velocity])
    expected = updated(start, prior, np.hstack([np.eye(3), delays]), point, noise)
    assert np.allclose(motion.states[0], expected[0], atol=1e-5)
    assert np.allclose(motion.covariances[0], expected[1], atol=1e-5)


def test_velocities_with_singular_information():
    rng, state, covariance, velocity, _, _ = scene(3)
    axis, motion = rng.standard_normal(3), Motion(one(state), one(covariance))
    update_velocities(motion, FIRST, one(velocity), one(np.outer(axis, axis)), FOREVER)
    row = np.concatenate([np.zeros(3), axis])[None]
    expected = updated(state, covariance, row, np.array([axis @ velocity]), np.eye(1))
    assert np.allclose(motion.states, expected[0], atol=1e-6)
    assert np.allclose(motion.covariances, expected[1], atol=1e-6)
    before = motion.states.copy()
    update_velocities(motion, FIRST, one(velocity), np.zeros((1, 1, 3, 3)), FOREVER)
    assert np.array_equal(motion.states, before)
