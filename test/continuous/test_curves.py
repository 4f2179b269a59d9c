"""Curves of single joints against dense linear algebra."""

import numpy as np
import pytest

from panoptic_ros.continuous.curves import (
    LASTING_S,
    ORDER,
    KnotGrid,
    WeightedRays,
    at_rays,
    covariances_at,
    cross_covariance,
    fit_curves,
    jerk_weights,
    persistence,
)
from panoptic_ros.geometry.splines import DEGREE, SPAN, spline

GRID = KnotGrid(0.0, 0.04, 20 + DEGREE)


def noise(rays):
    """Covariance (N, N) of the noise of the rays, in units of sigma^2."""
    gaps = np.abs(rays.times[:, None] - rays.times)
    same = np.zeros(gaps.shape, bool)
    for i in range(len(rays.times)):
        n = rays.previous[i]
        while n >= 0:
            same[i, n] = same[n, i] = True
            n = rays.previous[n]
    common = rays.lasting * np.minimum(rays.growths[:, None], rays.growths)
    return np.where(same, common * np.exp(-gaps / rays.memory), 0.0) + np.diag(rays.growths)


def random_rays(rng, lasting, count=40, cameras=2):
    times = np.sort(rng.uniform(0.02, 0.78, count))
    camera = rng.integers(0, cameras, count)
    previous = np.full(count, -1)
    for i in range(count):
        earlier = np.flatnonzero(camera[:i] == camera[i])
        if len(earlier):
            previous[i] = earlier[-1]
    return WeightedRays(
        np.array([0, count]),
        times,
        rng.standard_normal((count, 2, 3)),
        rng.standard_normal((count, 2)),
        rng.uniform(0.5, 1.5, count),
        rng.uniform(1.0, 2.0, count),
        previous,
        lasting,
        0.2,
    )


def dense(rays, stiffness):
    """Control points and their covariance by generalised least squares."""
    size = 3 * GRID.number
    basis = spline(GRID.origin, GRID.step, np.eye(GRID.number))(rays.times)  # (N, K)
    design = np.einsum("nk,nea->neka", basis, rays.rows).reshape(-1, size)
    scale = np.repeat(rays.sigmas, 2)
    weight = np.linalg.inv(np.kron(noise(rays), np.eye(2)) * np.outer(scale, scale))
    rough = np.zeros((GRID.number - ORDER, GRID.number))
    for k in range(len(rough)):
        rough[k, k : k + 4] = jerk_weights(GRID.step)
    prior = np.kron(rough.T @ np.diag(stiffness) @ rough, np.eye(3))
    normal = design.T @ weight @ design + prior + 1e-9 * stiffness.mean() * np.eye(size)
    return np.linalg.solve(normal, design.T @ weight @ rays.rights.reshape(-1)), np.linalg.inv(normal)


@pytest.mark.parametrize("lasting", [0.0, 0.4])
def test_a_curve_is_the_generalised_least_squares_solution(lasting):
    rng = np.random.default_rng(2)
    rays = random_rays(rng, lasting)
    # all rays of a camera are within the time over which rays are whitened, so Vecchia's form is exact
    rays = rays._replace(times=0.3 + (rays.times - rays.times.min()) * LASTING_S / np.ptp(rays.times) * 0.99)
    rays = rays._replace(previous=rays.previous) if lasting == 0.0 else few_per_camera(rays)
    stiffness = rng.uniform(0.5, 2.0, (1, GRID.number - ORDER))
    fit = fit_curves(rays, GRID, stiffness)
    points, covariance = dense(rays, stiffness[0])
    np.testing.assert_allclose(fit.points[0].reshape(-1), points, rtol=1e-5, atol=1e-5)
    at = covariances_at(fit.inverses, GRID, np.array([0.35]))[0, 0]
    basis = np.kron(spline(GRID.origin, GRID.step, np.eye(GRID.number))(0.35), np.eye(3))
    np.testing.assert_allclose(at, basis @ covariance @ basis.T, rtol=1e-4)
    whole = spline(GRID.origin, GRID.step, np.eye(GRID.number))(rays.times)
    design = np.einsum("nk,nea->neka", whole, rays.rows).reshape(len(whole), 2, -1)
    variances = np.einsum("nei,ij,nej->n", design, covariance, design)
    np.testing.assert_allclose(at_rays(fit, rays, GRID).variances, variances, rtol=1e-4)


def test_cross_covariances_are_those_of_the_dense_matrix():
    rng = np.random.default_rng(3)
    rays = random_rays(rng, 0.0)
    stiffness = rng.uniform(0.5, 2.0, (1, GRID.number - ORDER))
    fit, (_, covariance) = fit_curves(rays, GRID, stiffness), dense(rays, stiffness[0])
    found = np.empty((3, 3))
    for k, m in ((6, 6), (8, 7), (9, 6)):
        left, right = rng.standard_normal((2, SPAN))
        cross_covariance(fit.inverses[0], k, left, m, right, found)
        rows, columns = (slice(3 * i, 3 * (i + SPAN)) for i in (k, m))
        expected = np.kron(left, np.eye(3)) @ covariance[rows, columns] @ np.kron(right, np.eye(3)).T
        np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-8)


def few_per_camera(rays):
    """Let no ray have more than four previous ones of its camera."""
    previous = rays.previous.copy()
    depth = np.zeros(len(previous), int)
    for i, n in enumerate(previous):
        depth[i] = depth[n] + 1 if n >= 0 else 0
        if depth[i] > 4:
            previous[i], depth[i] = -1, 0
    return rays._replace(previous=previous)


def test_persistence_of_the_noise_is_found():
    rng = np.random.default_rng(5)
    rate, cameras, share = 60.0, 4, 0.4
    grid = KnotGrid(0.0, 0.04, 500 + DEGREE)
    times = np.tile(np.arange(0.02, 19.9, 1.0 / rate), cameras)
    camera = np.repeat(np.arange(cameras), len(times) // cameras)
    count = len(times) // cameras
    decay = np.exp(-1.0 / rate / 0.2)
    misses = np.empty((cameras, count, 2))
    for c in range(cameras):
        state = rng.standard_normal(2)
        for i in range(count):
            state = decay * state + np.sqrt(1.0 - decay**2) * rng.standard_normal(2)
            misses[c, i] = np.sqrt(share) * state + np.sqrt(1.0 - share) * rng.standard_normal(2)
    rows = np.random.default_rng(1).standard_normal((cameras, 2, 3))[camera]
    previous = np.arange(len(times)) - 1
    previous[::count] = -1
    order = np.argsort(times, kind="stable")
    places = np.empty(len(times), int)
    places[order] = np.arange(len(times))
    one = np.ones(len(times))
    rays = WeightedRays(
        np.array([0, len(times)]),
        times[order],
        rows[order],
        -misses.reshape(-1, 2)[order],
        one,
        one,
        np.where(previous < 0, -1, places[previous])[order],
        share,
        0.2,
    )
    fit = fit_curves(rays, grid, np.full((1, grid.number - ORDER), 1e3))
    at = at_rays(fit, rays, grid)
    left = np.einsum("nij,nj->ni", rays.rows, at.positions) - rays.rights
    assert persistence(fit, rays, grid, left, at.variances) == pytest.approx(share, abs=0.05)
