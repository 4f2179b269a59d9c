"""Filter and smoother against least squares over the whole sequence."""
import numpy as np

from panoptic_ros.refinement.kalman import predict, smooth, smoother_gains, update
from panoptic_ros.refinement.records import Motion, of_all

FOREVER = 1e9  # Cauchy scale: plain Gaussian
FIRST = np.array([0])  # row of the only person


def motion_of(state, covariance):
    """Of one joint of one person."""
    return Motion(state[None, None].astype(float), covariance[None, None].astype(float))


def updated(motion, point, noise, cauchy=FOREVER):
    """The motion with a point."""
    result = of_all(np.copy, motion)
    update(result, FIRST, point[None, None], noise[None, None], cauchy, np.empty((1, 1, 3)))
    return result


def predicted(motion, dt, q):
    ahead = of_all(np.empty_like, motion)
    predict(motion, dt, np.array([[q]]), ahead)
    return ahead


def smoothed(motion, dt, ahead, later):
    """One step backwards, and whether a joint that is measured then is so without an interruption."""
    gains, result, again = np.empty((1, 1, 6, 6)), of_all(np.copy, later), np.zeros((1, 1), bool)
    smoother_gains(motion, dt, ahead, gains)
    smooth(motion, gains, ahead, np.ones((1, 1), bool), result, again)
    return result, again[0, 0]


def filtered(points, noises, dts, q, speed=1.5):
    """All filtered and predicted moments of one point."""
    covariance = np.zeros((6, 6))
    covariance[:3, :3], covariance[3:, 3:] = noises[0], speed**2 * np.eye(3)
    moments = [(motion_of(np.concatenate([points[0], np.zeros(3)]), covariance), None)]
    for point, noise, dt in zip(points[1:], noises[1:], dts):
        ahead = predicted(moments[-1][0], dt, q)
        moments.append((updated(ahead, point, noise), ahead))
    return moments


def least_squares(points, noises, dts, q, speed=1.5):
    """Means (T, 6) and covariances of the same model, solved at once."""
    count = len(points)
    information, right = np.zeros((6 * count, 6 * count)), np.zeros(6 * count)

    def add(columns, matrix, value, noise):
        weight = np.linalg.inv(noise)
        information[np.ix_(columns, columns)] += matrix.T @ weight @ matrix
        right[columns] += matrix.T @ weight @ value

    for i in range(count):
        if np.isfinite(points[i, 0]):
            add(np.arange(6 * i, 6 * i + 3), np.eye(3), points[i], noises[i])
    add(np.arange(3, 6), np.eye(3), np.zeros(3), speed**2 * np.eye(3))
    for i, dt in enumerate(dts):
        transition = np.block([[np.eye(3), dt * np.eye(3)], [np.zeros((3, 3)), np.eye(3)]])
        process = q * np.kron([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]], np.eye(3))
        columns = np.arange(6 * i, 6 * i + 12)
        add(columns, np.hstack([transition, -np.eye(6)]), np.zeros(6), process)
    covariance = np.linalg.inv(information)
    blocks = [covariance[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] for i in range(count)]
    return (covariance @ right).reshape(count, 6), np.stack(blocks)


def test_smoother_equals_least_squares_at_uneven_rates_with_gaps():
    rng = np.random.default_rng(1)
    points = np.cumsum(rng.normal(0, 0.05, (12, 3)), axis=0)
    shapes = rng.normal(0, 0.01, (12, 3, 3))
    noises = shapes @ shapes.swapaxes(1, 2) + 1e-5 * np.eye(3)
    points[[4, 5]] = np.nan
    dts, q = rng.uniform(0.01, 0.08, 11), 4.0
    moments = filtered(points, noises, dts, q)
    means, covariances = least_squares(points, noises, dts, q)
    later = moments[-1][0]
    assert np.allclose(later.states[0, 0], means[-1], atol=1e-6)
    for i in range(10, -1, -1):
        later, again = smoothed(moments[i][0], dts[i], moments[i + 1][1], later)
        assert np.allclose(later.states[0, 0], means[i], atol=1e-6) and again
        assert np.allclose(later.covariances[0, 0], covariances[i], atol=1e-7, rtol=1e-4)


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
    update(motion, FIRST, np.full((1, 1, 3), 0.02), noise[None, None], 3.0, innovations)
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
    motion = Motion(state.copy(), np.tile(covariance, (3, 2, 1, 1)))
    noises, innovations = np.tile(0.1 * np.eye(3), (3, 2, 1, 1)), np.full((3, 2, 3), np.nan)
    update(motion, np.array([2, 0]), points, noises, 3.0, innovations)
    for p, j, point in ((2, 0, points[0, 0]), (2, 1, points[0, 1]), (0, 1, points[1, 1])):
        alone = updated(motion_of(state[p, j], covariance), point, noises[0, 0], 3.0)
        assert np.array_equal(motion.states[p, j], alone.states[0, 0])
        assert np.array_equal(motion.covariances[p, j], alone.covariances[0, 0])
    assert np.array_equal(motion.states[1], state[1]) and np.array_equal(motion.states[0, 0], state[0, 0])
    assert np.isfinite(innovations[..., 0]).tolist() == [[False, True], [False, False], [True, True]]
