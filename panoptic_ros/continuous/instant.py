"""Joints of one person at one instant, from a short window of views (kernels).

The result is a point of the curve of `continuous.problem`, with noise and stiffness that were learnt before.
It costs less: two solutions, covariances at the instant alone, and lengths near it alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.continuous.bones import INTERVAL_S
from panoptic_ros.continuous.curves import WeightedRays, normal_equations
from panoptic_ros.continuous.relaxation import relax
from panoptic_ros.geometry.robust import noise_growth
from panoptic_ros.geometry.splines import SPAN, basis_at, weights_at
from panoptic_ros.kernels import njit
from panoptic_ros.solving.bands import backward, factor, forward, forward_vector

Array = np.ndarray
LENGTHS_S = 0.3  # s about the instant in which lengths are measured
RELAXATIONS = 6  # iterations of conjugate gradients; more change the error by less than 1 %


class CameraRows(NamedTuple):
    """Cameras of a rig for rays.

    Args:
        rotations: (C, 3, 3) of cam_from_world.
        translations: (C, 3) m of cam_from_world.
        lines: (C,) s per row of the image, line delays.
        middles: (C,) px, row of the image at whose time a view has its timestamp.
    """

    rotations: Array
    translations: Array
    lines: Array
    middles: Array


class WindowRays(NamedTuple):
    """N rays of a window of views, ordered by joint and view.

    Args:
        weighted: `WeightedRays`.
        cameras: (N,) indices.
        scores: (N,) of the 2D joints.
        noises: (N,) standard deviations on the normalised plane.
    """

    weighted: WeightedRays
    cameras: Array
    scores: Array
    noises: Array


class InstantFit(NamedTuple):
    """J joints at an instant.

    Args:
        positions, velocities: (J, 3) m and m/s.
        covariances: (J, 3, 3) m^2.
        rays: `WindowRays` behind them, with their final weights.
    """

    positions: Array
    velocities: Array
    covariances: Array
    rays: WindowRays


@njit(cache=True, error_model="numpy", nogil=True)
def window_rays(seen, noises, cameras, cauchy, lasting, memory):
    """Return the rays of a window of views.

    Their robust weights come from the association.

    Args:
        seen: `SeenViews`.
        noises: (V, J) standard deviations on the normalised plane.
        cameras: `CameraRows`.
        cauchy: scale of the robust weights, in standard deviations.
        lasting, memory: see `WeightedRays`.
    """
    views, joints = seen.scores.shape
    total = 0
    for v in range(views):
        for j in range(joints):
            total += seen.scores[v, j] > 0.0
    starts, times = np.empty(joints + 1, np.int64), np.empty(total)
    rows, rights = np.empty((total, 2, 3)), np.empty((total, 2))
    sigmas, growths, previous = np.empty(total), np.empty(total), np.empty(total, np.int64)
    own, scores, planes = np.empty(total, np.int64), np.empty(total), np.empty(total)
    newest = np.empty(len(cameras.lines), np.int64)
    n = 0
    for j in range(joints):
        starts[j] = n
        newest[:] = -1
        for v in range(views):
            if not seen.scores[v, j] > 0.0:
                continue
            c = seen.cameras[v]
            r, t = cameras.rotations[c], cameras.translations[c]
            times[n] = seen.times[v] + cameras.lines[c] * (seen.heights[v, j] - cameras.middles[c])
            for e in range(2):
                point = seen.plane[v, j, e]
                rights[n, e] = t[e] - point * t[2]
                for a in range(3):
                    rows[n, e, a] = point * r[2, a] - r[e, a]
            sigmas[n] = noises[v, j] * seen.depths[v]
            growths[n] = noise_growth(seen.squares[v, j], cauchy)
            previous[n], newest[c] = newest[c], n
            own[n], scores[n], planes[n] = c, seen.scores[v, j], noises[v, j]
            n += 1
    starts[joints] = n
    weighted = WeightedRays(starts, times, rows, rights, sigmas, growths, previous, lasting, memory)
    return WindowRays(weighted, own, scores, planes)


@njit(cache=True, error_model="numpy", nogil=True)
def solve_points(rays, grid, stiffness):
    """Return the control points (J, K, 3) m of the curves, and the Cholesky factors (J, 3K, WIDTH).

    Args:
        rays, grid, stiffness: see `curves.fit_curves`.
    """
    factors, rights = normal_equations(rays, grid, stiffness)
    points = np.full((len(factors), grid.number, 3), np.nan)
    for j in range(len(factors)):
        if factor(factors[j]):
            forward_vector(factors[j], rights[j])
            backward(factors[j], rights[j])
            points[j] = rights[j].reshape(grid.number, 3)
    return points, factors


@njit(cache=True, error_model="numpy", nogil=True)
def weigh(rays, points, grid, cameras, least_depth, cauchy):
    """Update standard deviations and robust weights of `WindowRays` from curves, in place."""
    weighted = rays.weighted
    basis, place = np.empty(SPAN), np.empty(3)
    for j in range(len(weighted.starts) - 1):
        for n in range(weighted.starts[j], weighted.starts[j + 1]):
            at = (weighted.times[n] - grid.origin) / grid.step
            k = weights_at(at, grid.number, basis)
            for a in range(3):
                place[a] = 0.0
                for p in range(SPAN):
                    place[a] += basis[p] * points[j, k + p, a]
            c = rays.cameras[n]
            depth = cameras.translations[c, 2]
            for a in range(3):
                depth += cameras.rotations[c, 2, a] * place[a]
            weighted.sigmas[n] = rays.noises[n] * max(depth, least_depth)
            square = 0.0
            for e in range(2):
                miss = -weighted.rights[n, e]
                for a in range(3):
                    miss += weighted.rows[n, e, a] * place[a]
                square += miss * miss
            weighted.growths[n] = noise_growth(square / weighted.sigmas[n] ** 2, cauchy)


@njit(cache=True, error_model="numpy", nogil=True)
def fit_instant(rays, grid, stiffness, cameras, least_depth, cauchy, time, pairs, learnt):
    """Return the joints at a time (s), `InstantFit`.

    Args:
        rays: `WindowRays`, updated.
        grid: `KnotGrid` that contains the rays and the time.
        stiffness: (J, K - ORDER) 1/m^2.
        cameras: `CameraRows`.
        least_depth: (m) see `problem.LEAST_DEPTH`.
        cauchy: scale of the robust weights, in standard deviations.
        pairs, learnt: (P, 2) joints and their `LearntLengths`; P may be 0.
    """
    points, _ = solve_points(rays.weighted, grid, stiffness)
    weigh(rays, points, grid, cameras, least_depth, cauchy)
    points, factors = solve_points(rays.weighted, grid, stiffness)
    if len(pairs):
        begin = max(rays.weighted.times.min(), time - LENGTHS_S)
        end = min(rays.weighted.times.max(), time + LENGTHS_S)
        first, final = int(np.ceil((begin - time) / INTERVAL_S)), int(np.floor((end - time) / INTERVAL_S))
        instants = time + INTERVAL_S * np.arange(first, final + 1)
        points = points + relax(factors, points, grid, instants, pairs, learnt, RELAXATIONS)
    joints = len(points)
    positions, velocities = np.zeros((joints, 3)), np.zeros((joints, 3))
    covariances = np.empty((joints, 3, 3))
    basis, slope, bend = np.empty(SPAN), np.empty(SPAN), np.empty(SPAN)
    k = basis_at((time - grid.origin) / grid.step, grid.number, basis, slope, bend)
    for j in range(joints):
        for p in range(SPAN):
            for a in range(3):
                positions[j, a] += basis[p] * points[j, k + p, a]
                velocities[j, a] += slope[p] / grid.step * points[j, k + p, a]
        column = np.zeros((3 * (grid.number - k), 3))
        for p in range(SPAN):
            for a in range(3):
                column[3 * p + a, a] = basis[p]
        forward(factors[j, 3 * k :], column)
        for a in range(3):
            for b in range(3):
                covariances[j, a, b] = (column[:, a] * column[:, b]).sum()
    return InstantFit(positions, velocities, covariances, rays)
