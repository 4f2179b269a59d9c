"""The isotropic constant-velocity filter against the textbook."""

import numpy as np

from test.support.motion_filter import predict_motion, update_motion


def test_equals_a_dense_kalman_filter():
    rng = np.random.default_rng(0)
    dt, density, noise, speed = 0.04, 2.0, 0.01**2, 1.5
    transition = np.array([[1, dt], [0, 1]])
    process = density * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    states, variances = np.full((1, 6), np.nan), np.zeros((1, 3))
    mean, spread = np.zeros((2, 3)), np.diag([noise, speed**2])
    for i in range(20):
        point = rng.normal(0, 1, (1, 3))
        states, variances = predict_motion(states, variances, dt, density)
        states, variances = update_motion(states, variances, point, np.array([noise]), speed)
        if i == 0:
            mean[0] = point[0]
        else:
            mean, spread = transition @ mean, transition @ spread @ transition.T + process
            gain = spread[:, 0] / (spread[0, 0] + noise)
            mean, spread = mean + np.outer(gain, point[0] - mean[0]), spread - np.outer(gain, spread[0])
        assert np.allclose(states[0], mean.ravel())
        assert np.allclose(variances[0], [spread[0, 0], spread[0, 1], spread[1, 1]])


def test_missing_points_change_nothing():
    states, variances = np.ones((2, 6)), np.ones((2, 3))
    points = np.array([[np.nan] * 3, [2.0, 2.0, 2.0]])
    new, _ = update_motion(states, variances, points, np.array([np.nan, 1.0]), 1.0)
    assert np.array_equal(new[0], states[0]) and not np.array_equal(new[1], states[1])
