"""Information of rays about clocks against dense linear algebra."""

import numpy as np
import pytest

from panoptic_ros.continuous.clock_sums import TERMS, clock_sums, eliminate
from panoptic_ros.continuous.curves import MOST, ORDER, KnotGrid, WeightedRays, fit_curves, whiten
from panoptic_ros.geometry.splines import DEGREE, spline

GRID = KnotGrid(0.0, 0.04, 20 + DEGREE)
COUNT, CAMERAS = 60, 2
RNG = np.random.default_rng(4)
CAMERA = np.tile([0, 1], COUNT // 2)


def rays_with(lasting):
    """Rays of two cameras in turn."""
    rng = np.random.default_rng(5)
    return WeightedRays(
        np.array([0, COUNT]),
        np.sort(rng.uniform(0.0, 0.8, COUNT)),
        *(rng.standard_normal(shape) for shape in ((COUNT, 2, 3), (COUNT, 2))),
        *(rng.uniform(1.0, 2.0, COUNT) for _ in range(2)),
        np.where(np.arange(COUNT) < CAMERAS, -1, np.arange(COUNT) - CAMERAS),
        lasting,
        0.2,
    )


@pytest.mark.parametrize("lasting", [0.0, 0.4])
def test_sums_are_those_of_dense_rows(lasting):
    rays = rays_with(lasting)
    fit = fit_curves(rays, GRID, np.full((1, GRID.number - ORDER), 2.0))
    misses, factors = RNG.standard_normal((COUNT, 2)), RNG.standard_normal((COUNT, TERMS))
    found = clock_sums(fit, rays, GRID, misses, CAMERA, factors, CAMERAS)
    curve = spline(GRID.origin, GRID.step, np.eye(GRID.number))
    value, slope = (
        np.einsum("nk,nea->neka", curve(rays.times, d), rays.rows).reshape(COUNT, 2, -1) for d in (0, 1)
    )
    # the control points in the band of a factor are correlated with all others: invert the whole matrix
    lower = np.zeros((3 * GRID.number, 3 * GRID.number))
    for k in range(fit.factors.shape[2]):
        lower[np.arange(k, len(lower)), np.arange(len(lower) - k)] = fit.factors[0, k:, k]
    covariance = np.linalg.inv(lower @ lower.T)
    size, points = TERMS * CAMERAS, fit.points[0].ravel()
    information, blur, right = np.zeros((size, size)), np.zeros((size, size)), np.zeros(size)
    coupling = np.zeros((len(points), size))
    members, shares, work = np.empty(MOST + 1, np.int64), np.empty(MOST + 1), np.empty((MOST, MOST + 1))
    for i in range(COUNT):
        number, variance = whiten(rays, i, members, shares, work)
        own = members[:number]
        scale = shares[:number] / rays.sigmas[own]
        row = np.einsum("m,mei->ei", scale, value[own])
        slopes = np.einsum("m,mp,mei->pei", scale, factors[own], slope[own])
        miss, change = scale @ misses[own], slopes @ points  # (2,) and (TERMS, 2)
        at = CAMERAS * np.arange(TERMS) + CAMERA[i]
        information[np.ix_(at, at)] += change @ change.T / variance
        blur[np.ix_(at, at)] += np.einsum("pei,ij,qej->pq", slopes, covariance, slopes) / variance
        bend = np.einsum("pei,ij,ej->p", slopes, covariance, row)
        right[at] -= (change @ miss + bend) / variance
        coupling[:, at] += np.einsum("pe,ei->ip", change, row) / variance
    for one, expected in zip(
        (*found[:2], found[2].sum(axis=0), found[3][0]), (information, blur, right, coupling)
    ):
        np.testing.assert_allclose(one, expected, rtol=1e-7, atol=1e-7 * np.abs(expected).max())
    left = found[0].copy()
    eliminate(left, found[3], fit.factors)
    np.testing.assert_allclose(
        left, information - coupling.T @ covariance @ coupling, atol=1e-7 * information.max()
    )
