"""Filter and smoother against least squares over the whole sequence."""

import numpy as np
import pytest
from gaussians import conditioned, positive

from panoptic_ros.domain.of_all import of_all
from panoptic_ros.refinement.kalman import predict, smooth, smoother_gains, update, update_velocities
from panoptic_ros.refinement.motion_model import NINE, SIX, transition
from panoptic_ros.refinement.records import MotionStates

FOREVER = 1e9  # Cauchy scale: plain Gaussian
FIRST = np.array([0])  # row of the only person
AT_ONCE = np.zeros((0, 1, 3, 3))  # delays of views that have one stamp


def motion_of(state, covariance):
    """Of one joint of one person."""
    return MotionStates(state[None, None].astype(float), covariance[None, None].astype(float))


def sized(motion):
    """A tuple as long as the states."""
    return SIX if motion.states.shape[-1] == 6 else NINE


def updated(motion, point, noise, cauchy=FOREVER):
    """The motion with a point."""
    result = of_all(np.copy, motion)
    measured = point[None, None], noise[None, None], AT_ONCE
    update(sized(motion), result, FIRST, measured, cauchy, np.empty((1, 1, 3)))
    return result


def predicted(motion, dt, q, memory=0.0):
    ahead = of_all(np.empty_like, motion)
    predict(sized(motion), motion, transition(dt, memory), np.array([[q]]), ahead)
    return ahead


def smoothed(motion, dt, ahead, later, memory=0.0):
    """One step backwards, and whether a joint that is measured then is so without an interruption."""
    gains, result, again = np.empty_like(motion.covariances), of_all(np.copy, later), np.zeros((1, 1), bool)
    smoother_gains(sized(motion), motion, transition(dt, memory), ahead, gains)
    smooth(sized(motion), motion, gains, ahead, np.ones((1, 1), bool), result, again)
    return result, again[0, 0]


def filtered(points, noises, dts, q, memory, first):
    """All filtered and predicted moments of one point; first: variances of velocity, and acceleration."""
    covariance = np.diag([0.0] * 3 + first)
    covariance[:3, :3] = noises[0]
    moments = [(motion_of(np.concatenate([points[0], np.zeros(len(first))]), covariance), None)]
    for point, noise, dt in zip(points[1:], noises[1:], dts):
        ahead = predicted(moments[-1][0], dt, q, memory)
        moments.append((updated(ahead, point, noise), ahead))
    return moments


def least_squares(points, noises, dts, q, memory, first):
    """Means (T, S) and covariances of the same model, solved at once."""
    count, size = len(points), 3 + len(first)
    information, right = np.zeros((size * count, size * count)), np.zeros(size * count)

    def add(columns, matrix, value, noise):
        weight = np.linalg.inv(noise)
        information[np.ix_(columns, columns)] += matrix.T @ weight @ matrix
        right[columns] += matrix.T @ weight @ value

    for i in range(count):
        if np.isfinite(points[i, 0]):
            add(np.arange(size * i, size * i + 3), np.eye(3), points[i], noises[i])
    add(np.arange(3, size), np.eye(size - 3), np.zeros(size - 3), np.diag(first))
    for i, dt in enumerate(dts):
        step = transition(dt, memory)
        process = q * np.kron(step.spread, np.eye(3))
        columns = np.arange(size * i, size * (i + 2))
        forward = np.kron(step.forward, np.eye(3))
        add(columns, np.hstack([forward, -np.eye(size)]), np.zeros(size), process)
    covariance = np.linalg.inv(information)
    blocks = [covariance[size * i : size * (i + 1), size * i : size * (i + 1)] for i in range(count)]
    return (covariance @ right).reshape(count, size), np.stack(blocks)


@pytest.mark.parametrize(("memory", "first"), [(0.0, [2.25] * 3), (0.1, [2.25] * 3 + [20.0] * 3)])
def test_smoother_equals_least_squares_at_uneven_rates_with_gaps(memory, first):
    rng = np.random.default_rng(1)
    points = np.cumsum(rng.normal(0, 0.05, (12, 3)), axis=0)
    shapes = rng.normal(0, 0.01, (12, 3, 3))
    noises = shapes @ shapes.swapaxes(1, 2) + 1e-5 * np.eye(3)
    points[[4, 5]] = np.nan
    dts, q = rng.uniform(0.01, 0.08, 11), 4.0
    moments = filtered(points, noises, dts, q, memory, first)
    means, covariances = least_squares(points, noises, dts, q, memory, first)
    later = moments[-1][0]
    assert np.allclose(later.states[0, 0], means[-1], atol=1e-6, rtol=1e-4)
    for i in range(10, -1, -1):
        later, again = smoothed(moments[i][0], dts[i], moments[i + 1][1], later, memory)
        assert np.allclose(later.states[0, 0], means[i], atol=1e-6, rtol=1e-4) and again
        assert np.allclose(later.covariances[0, 0], covariances[i], atol=1e-7, rtol=1e-3)


def test_large_innovations_count_less():
    motion = motion_of(np.zeros(6), np.diag([1e-4] * 3 + [0.1] * 3))
    moved = []
    for distance in (0.01, 1.0):
        result = updated(motion, np.array([distance, 0.0, 0.0]), 1e-4 * np.eye(3), 3.0)
        moved.append(result.states[0, 0, 0] / distance)
    assert moved[0] > 0.45 and moved[1] < 0.01


def test_innovations_are_whitened():
    motion, noise = motion_of(np.zeros(6), np.diag([3e-4] * 3 + [0.1] * 3)), 1e-4 * np.eye(3)
    innovations = np.empty((1, 1, 3))
    measured = np.full((1, 1, 3), 0.02), noise[None, None], AT_ONCE
    update(SIX, motion, FIRST, measured, 3.0, innovations)
    assert np.allclose(innovations, 1.0)


def test_unknown_points_stay_unknown():
    unknown, ones = motion_of(np.full(6, np.nan), np.zeros((6, 6))), motion_of(np.ones(6), np.eye(6))
    ahead = predicted(unknown, 0.1, 1.0)
    result, again = smoothed(ones, 0.1, ahead, ones)
    assert np.isnan(ahead.states).all() and np.array_equal(result.states, ones.states) and not again
    assert np.isnan(updated(unknown, np.ones(3), np.eye(3)).states).all()


def test_people_are_updated_by_row():
    rng = np.random.default_rng(2)
    state, covariance, points = rng.standard_normal((3, 2, 6)), np.eye(6), rng.standard_normal((2, 2, 3))
    points[1, 0] = np.nan
    motion = MotionStates(state.copy(), np.tile(covariance, (3, 2, 1, 1)))
    noises, innovations = np.tile(0.1 * np.eye(3), (3, 2, 1, 1)), np.full((3, 2, 3), np.nan)
    measured = points, noises, np.zeros((0, 2, 3, 3))
    update(SIX, motion, np.array([2, 0]), measured, 3.0, innovations)
    for p, j, point in ((2, 0, points[0, 0]), (2, 1, points[0, 1]), (0, 1, points[1, 1])):
        alone = updated(motion_of(state[p, j], covariance), point, noises[0, 0], 3.0)
        assert np.array_equal(motion.states[p, j], alone.states[0, 0])
        assert np.array_equal(motion.covariances[p, j], alone.covariances[0, 0])
    assert np.array_equal(motion.states[1], state[1]) and np.array_equal(motion.states[0, 0], state[0, 0])
    assert np.isfinite(innovations[..., 0]).tolist() == [[False, True], [False, False], [True, True]]


def one(array):
    """Of the only joint of the only person."""
    return array[None, None].copy()


def scene(seed):
    rng = np.random.default_rng(seed)
    return (
        rng,
        rng.standard_normal(6),
        positive(rng, 6, 0.3),
        rng.standard_normal(3),
        positive(rng, 3, 0.1),
        0.02 * rng.standard_normal((3, 3)),
    )


def test_a_position_in_motion_is_one_measurement():
    _, state, covariance, point, noise, delays = scene(0)
    motion = MotionStates(one(state), one(covariance))
    measured = one(point), one(noise), one(delays)
    update(SIX, motion, FIRST, measured, FOREVER, np.empty((1, 1, 3)))
    expected = conditioned(state, covariance, np.hstack([np.eye(3), delays]), point, noise)
    assert np.allclose(motion.states, expected[0]) and np.allclose(motion.covariances, expected[1])


def test_without_delays_it_is_a_position():
    _, state, covariance, point, noise, delays = scene(1)
    still, moving = (MotionStates(one(state), one(covariance)) for _ in range(2))
    update(SIX, still, FIRST, (one(point), one(noise), AT_ONCE), 3.0, np.empty((1, 1, 3)))
    update(SIX, moving, FIRST, (one(point), one(noise), one(0.0 * delays)), 3.0, np.empty((1, 1, 3)))
    assert np.allclose(still.states, moving.states) and np.allclose(still.covariances, moving.covariances)


def test_velocities_with_singular_information():
    rng, state, covariance, velocity, _, _ = scene(3)
    axis, motion = rng.standard_normal(3), MotionStates(one(state), one(covariance))
    update_velocities(SIX, motion, FIRST, one(velocity), one(np.outer(axis, axis)), FOREVER)
    row = np.concatenate([np.zeros(3), axis])[None]
    expected = conditioned(state, covariance, row, np.array([axis @ velocity]), np.eye(1))
    assert np.allclose(motion.states, expected[0], atol=1e-6)
    assert np.allclose(motion.covariances, expected[1], atol=1e-6)
    before = motion.states.copy()
    update_velocities(SIX, motion, FIRST, one(velocity), np.zeros((1, 1, 3, 3)), FOREVER)
    assert np.array_equal(motion.states, before)
