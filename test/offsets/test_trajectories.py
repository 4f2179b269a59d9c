"""The kernel against the same written with dense matrices."""

import numpy as np
from scipy.interpolate import BSpline

from panoptic_ros.offsets.trajectories import Curves, ObservationRays, fit_series

STEP = 0.1


def dense(times, cameras, since, rows, rights, weights, origin, count, stiffness, clocks):
    """Information and right-hand side of the clocks, by dense algebra and scipy's splines."""
    knots = origin + STEP * np.arange(-3, count + 1)
    basis = BSpline(knots, np.eye(count), 3)
    values, slopes = basis(times), basis.derivative()(times)
    row = (rows[:, :, None, :] * values[:, None, :, None]).reshape(-1, 3 * count)
    slope = (rows[:, :, None, :] * slopes[:, None, :, None]).reshape(-1, 3 * count)
    weight = np.repeat(weights, 2)
    differences = np.kron(np.diff(np.eye(count), 2, axis=0), np.eye(3))
    hessian = (row * weight[:, None]).T @ row + stiffness * (differences.T @ differences)
    hessian += 1e-9 * stiffness * np.eye(3 * count)
    inverse = np.linalg.inv(hessian)
    z = inverse @ (row.T @ (weight * rights.ravel()))
    d = slope @ z
    miss = row @ z - rights.ravel()
    pick = np.zeros((len(d), 2 * clocks))
    owner, tau = np.repeat(cameras, 2), np.repeat(since, 2)
    pick[np.arange(len(d)), owner] = 1.0
    pick[np.arange(len(d)), clocks + owner] = tau
    jacobian = pick * d[:, None]
    cross = (row * weight[:, None]).T @ jacobian
    information = (jacobian * weight[:, None]).T @ jacobian - cross.T @ inverse @ cross
    bend = ((slope @ inverse) * row).sum(axis=1)
    right = -pick.T @ (weight * (d * miss + bend))
    leverage = (weight * ((row @ inverse) * row).sum(axis=1)).reshape(-1, 2).sum(axis=1)
    rough = (differences @ z) @ (differences @ z), np.trace(differences @ inverse @ differences.T)
    return information, right, leverage, rough


def test_kernel_agrees_with_dense_algebra_over_two_series():
    rng = np.random.default_rng(4)
    n, count, clocks = 60, 14, 3
    times = np.concatenate([np.sort(rng.uniform(0.1, 1.0, n)), np.sort(rng.uniform(2.1, 3.0, n))])
    cameras, since = rng.integers(0, clocks, 2 * n), times - 1.5
    rows, rights = rng.normal(size=(2 * n, 2, 3)), rng.normal(size=(2 * n, 2))
    weights = rng.uniform(0.2, 1.0, 2 * n)
    stiffness, origins = np.array([3.0, 40.0]), np.array([0.0, 2.0])
    curves = Curves(np.array([0, n, 2 * n]), origins, np.array([count, count]), STEP, stiffness)
    fit = fit_series(curves, ObservationRays(times, cameras, since, rows, rights, weights), clocks)
    parts = [
        dense(times[p], cameras[p], since[p], rows[p], rights[p], weights[p], o, count, s, clocks)
        for p, o, s in ((slice(0, n), 0.0, 3.0), (slice(n, 2 * n), 2.0, 40.0))
    ]
    np.testing.assert_allclose(fit.information, parts[0][0] + parts[1][0], rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(fit.right, parts[0][1] + parts[1][1], rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(fit.leverage, np.concatenate([parts[0][2], parts[1][2]]), rtol=1e-7)
    np.testing.assert_allclose(fit.rough, [parts[0][3], parts[1][3]], rtol=1e-7)
