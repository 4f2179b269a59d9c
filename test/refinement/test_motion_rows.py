"""Measurements of position and velocity together against the textbook's matrices."""
import numpy as np

from panoptic_ros.refinement.kalman import update_states
from panoptic_ros.refinement.motion_rows import start_moving, update_moving, update_velocities

FOREVER = 1e9  # Cauchy scale: plain Gaussian


def positive(rng, size, scale):
    factor = scale * rng.standard_normal((size, size))
    return factor @ factor.T + 1e-3 * scale**2 * np.eye(size)


def updated(state, covariance, matrix, value, noise):
    gain = covariance @ matrix.T @ np.linalg.inv(matrix @ covariance @ matrix.T + noise)
    return state + gain @ (value - matrix @ state), covariance - gain @ matrix @ covariance


def scene(seed):
    rng = np.random.default_rng(seed)
    return (
        rng, rng.standard_normal(6), positive(rng, 6, 0.3), rng.standard_normal(3), positive(rng, 3, 0.1),
        0.02 * rng.standard_normal((3, 3)),
    )  # fmt: skip


def test_a_position_in_motion_is_one_measurement():
    _, state, covariance, point, noise, delays = scene(0)
    states, covariances = state[None].copy(), covariance[None].copy()
    update_moving(states, covariances, point[None], noise[None], delays[None], FOREVER, np.empty((1, 3)))
    expected = updated(state, covariance, np.hstack([np.eye(3), delays]), point, noise)
    assert np.allclose(states[0], expected[0]) and np.allclose(covariances[0], expected[1])


def test_without_delays_it_is_a_position():
    _, state, covariance, point, noise, _ = scene(1)
    results = []
    for still in (True, False):
        states, covariances = state[None].copy(), covariance[None].copy()
        if still:
            update_states(states, covariances, point[None], noise[None], 3.0, np.empty((1, 3)))
        else:
            now = np.empty((1, 3))
            update_moving(states, covariances, point[None], noise[None], np.zeros((1, 3, 3)), 3.0, now)
        results.append((states, covariances))
    assert np.allclose(results[0][0], results[1][0]) and np.allclose(results[0][1], results[1][1])


def test_a_new_point_starts_as_if_its_position_had_been_unknown():
    rng, _, _, point, noise, delays = scene(2)
    velocity, spread = rng.standard_normal(3), positive(rng, 3, 1.5)
    states, covariances = np.full((1, 6), np.nan), np.zeros((1, 6, 6))
    start_moving(
        states, covariances, point[None], noise[None], delays[None], velocity[None], spread[None]
    )
    prior = np.zeros((6, 6))
    prior[:3, :3], prior[3:, 3:] = 1e8 * np.eye(3), spread
    start = np.concatenate([np.zeros(3), velocity])
    expected = updated(start, prior, np.hstack([np.eye(3), delays]), point, noise)
    assert np.allclose(states[0], expected[0], atol=1e-5)
    assert np.allclose(covariances[0], expected[1], atol=1e-5)


def test_velocities_with_singular_information():
    rng, state, covariance, velocity, _, _ = scene(3)
    axis = rng.standard_normal(3)
    states, covariances = state[None].copy(), covariance[None].copy()
    update_velocities(states, covariances, velocity[None], np.outer(axis, axis)[None], FOREVER)
    row = np.concatenate([np.zeros(3), axis])[None]
    expected = updated(state, covariance, row, np.array([axis @ velocity]), np.eye(1))
    assert np.allclose(states[0], expected[0], atol=1e-6)
    assert np.allclose(covariances[0], expected[1], atol=1e-6)
    before = states.copy()
    update_velocities(states, covariances, velocity[None], np.zeros((1, 3, 3)), FOREVER)
    assert np.array_equal(states, before)
