"""Filter and smoother against least squares over the whole sequence."""
import numpy as np

from panoptic_ros.refinement.kalman import predict_states, smooth_states, update_states

FOREVER = 1e9  # Cauchy scale: plain Gaussian


def filtered(points, noises, dts, q, speed=1.5):
    """All filtered and predicted moments of one point."""
    states = np.concatenate([points[0], np.zeros(3)])[None]
    covariances = np.zeros((1, 6, 6))
    covariances[0, :3, :3], covariances[0, 3:, 3:] = noises[0], speed**2 * np.eye(3)
    moments = [(states, covariances, None, None)]
    for point, noise, dt in zip(points[1:], noises[1:], dts):
        ahead, spread = predict_states(states, covariances, dt, np.array([q]))
        states, covariances = ahead.copy(), spread.copy()
        update_states(states, covariances, point[None], noise[None], FOREVER, np.empty((1, 3)))
        moments.append((states, covariances, ahead, spread))
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
    states, spread = moments[-1][:2]
    assert np.allclose(states[0], means[-1], atol=1e-6)
    for i in range(10, -1, -1):
        now, ahead = moments[i], moments[i + 1]
        states, spread = smooth_states(now[0], now[1], dts[i], ahead[2], ahead[3], states, spread)
        assert np.allclose(states[0], means[i], atol=1e-6)
        assert np.allclose(spread[0], covariances[i], atol=1e-7, rtol=1e-4)


def test_large_innovations_count_less():
    covariances, noise = np.zeros((1, 6, 6)), 1e-4 * np.eye(3)[None]
    covariances[0] = np.diag([1e-4] * 3 + [0.1] * 3)
    moved = []
    for distance in (0.01, 1.0):
        states, spread = np.zeros((1, 6)), covariances.copy()
        update_states(states, spread, np.array([[distance, 0, 0]]), noise, 3.0, np.empty((1, 3)))
        moved.append(states[0, 0] / distance)
    assert moved[0] > 0.45 and moved[1] < 0.01


def test_unknown_points_stay_unknown():
    states, covariances = np.full((1, 6), np.nan), np.zeros((1, 6, 6))
    ahead, spread = predict_states(states, covariances, 0.1, np.ones(1))
    later = np.ones((1, 6))
    smoothed, _ = smooth_states(np.ones((1, 6)), np.eye(6)[None], 0.1, ahead, spread, later, np.eye(6)[None])
    assert np.isnan(ahead).all() and np.array_equal(smoothed, np.ones((1, 6)))
