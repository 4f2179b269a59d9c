"""Fit the trajectory of every joint to its rays, and compute its information about the clocks (kernels).

A trajectory is a uniform cubic B-spline with a penalty on its second differences, the prior of white
acceleration. Observation i at the corrected time t_i is the linear pair of rows A_i X(t_i) = b_i. If the
clock of its camera changes by e, the residual changes by d_i e, with d_i = A_i X'(t_i). Elimination of the
spline (banded Cholesky, `solving.bands`) leaves a small system for the clocks.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.solving.bands import backward, factor, forward, inverse_in_band

SPAN = 4  # number of control points with influence at an instant
WIDTH = 3 * SPAN  # band width for three coordinates


class SeriesFit(NamedTuple):
    """S trajectories fitted to N observations, given the clocks of C cameras.

    Args:
        information: (2C, 2C) of the clocks' offsets and drifts.
        right: (2C,) right-hand side.
        positions, velocities: (N, 3) of the trajectory at each observation, m and m/s.
        leverage: (N,) share of an observation that its trajectory follows.
        rough: (S, 2) sum of squared second differences, and the trace of their covariance.
    """

    information: np.ndarray
    right: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray
    leverage: np.ndarray
    rough: np.ndarray


class ObservationRays(NamedTuple):
    """Rays of N observations.

    Args:
        times: (N,) s, corrected.
        cameras: (N,) indices.
        since: (N,) s, uncorrected, from the reference time of the clocks.
        rows, rights: (N, 2, 3) and (N, 2), in units of the noise.
        weights: (N,) robust weights.
    """

    times: np.ndarray
    cameras: np.ndarray
    since: np.ndarray
    rows: np.ndarray
    rights: np.ndarray
    weights: np.ndarray


class Curves(NamedTuple):
    """S trajectories.

    Args:
        starts: (S + 1,) index of the first observation of each.
        origins: (S,) s, time of the first knot.
        counts: (S,) number of control points.
        step: (s) time between knots.
        stiffness: (S,) penalty on squared second differences.
    """

    starts: np.ndarray
    origins: np.ndarray
    counts: np.ndarray
    step: float
    stiffness: np.ndarray


class _Knots(NamedTuple):
    """Knots of one trajectory, and the range first..last (exclusive) of its observations.

    Args:
        first, last: indices of its first observation and of that of the next trajectory.
        origin: (s) time of the first knot.
        number: number of control points.
        step: (s) time between knots.
    """

    first: int
    last: int
    origin: float
    number: int
    step: float


class _ClockSums(NamedTuple):
    """Sums for C clocks.

    Args:
        own: (2C, 2C) information.
        right: (2C,) right-hand side.
        cross: (n, 2C) coupling to the n coordinates of a trajectory.
    """

    own: np.ndarray
    right: np.ndarray
    cross: np.ndarray


class _CurveValues(NamedTuple):
    """Values of the trajectory per observation: positions and velocities (N, 3), and leverage (N,)."""

    positions: np.ndarray
    velocities: np.ndarray
    leverage: np.ndarray


@njit(cache=True, error_model="numpy")
def basis_at(place, count, basis, slope):
    """Compute the weights (4,) of control points at `place` (in knots) and their derivatives.

    Returns: the index of the first of these control points.
    """
    k = min(max(int(np.floor(place)), 0), count - SPAN)
    u = place - k
    v = 1.0 - u
    basis[0] = v * v * v / 6.0
    basis[1] = (3.0 * u * u * u - 6.0 * u * u + 4.0) / 6.0
    basis[2] = (-3.0 * u * u * u + 3.0 * u * u + 3.0 * u + 1.0) / 6.0
    basis[3] = u * u * u / 6.0
    slope[0] = -0.5 * v * v
    slope[1] = 1.5 * u * u - 2.0 * u
    slope[2] = -1.5 * u * u + u + 0.5
    slope[3] = 0.5 * u * u
    return k


@njit(cache=True, error_model="numpy")
def fit_series(curves, rays, clocks):
    """Fit all trajectories.

    Args:
        curves: `Curves`.
        rays: `ObservationRays`.
        clocks: number of cameras.
    """
    series = len(curves.counts)
    unknowns = 2 * clocks
    information, right = np.zeros((unknowns, unknowns)), np.zeros(unknowns)
    total = len(rays.times)
    followed = _CurveValues(np.zeros((total, 3)), np.zeros((total, 3)), np.zeros(total))
    rough, own = np.zeros((series, 2)), np.empty((unknowns, unknowns))
    for s in range(series):
        knots = _Knots(
            curves.starts[s], curves.starts[s + 1], curves.origins[s], curves.counts[s], curves.step
        )
        n = 3 * knots.number
        band, z = np.zeros((n, WIDTH)), np.zeros(n)
        add_penalty(band, curves.stiffness[s])
        add_observations(band, z, knots, rays)
        if not factor(band):
            continue
        column = z.reshape(n, 1)
        forward(band, column)
        backward(band, z)
        inverse = inverse_in_band(band)
        penalty_moments(z, inverse, rough[s])
        cross = np.zeros((n, unknowns))
        own[:] = 0.0
        add_clocks(_ClockSums(own, right, cross), z, inverse, knots, rays, followed)
        forward(band, cross)
        information += own - cross.T @ cross
    return SeriesFit(information, right, followed.positions, followed.velocities, followed.leverage, rough)


@njit(cache=True, error_model="numpy")
def add_penalty(band, stiffness):
    """Add the penalty on second differences of the control points, and a small ridge."""
    n = len(band)
    for i in range(n):
        band[i, 0] += 1e-9 * stiffness
    for i in range(0, n - 6):  # coordinate i % 3 of control point i // 3 and of the next two
        band[i, 0] += stiffness
        band[i + 3, 0] += 4.0 * stiffness
        band[i + 6, 0] += stiffness
        band[i + 3, 3] -= 2.0 * stiffness
        band[i + 6, 3] -= 2.0 * stiffness
        band[i + 6, 6] += stiffness


@njit(cache=True, error_model="numpy")
def add_observations(band, z, knots, rays):
    """Add the normal equations of the observations of one trajectory."""
    first, last, origin, count, step = knots
    times, _, _, rows, rights, weights = rays
    basis, slope = np.empty(SPAN), np.empty(SPAN)
    normal, side = np.empty((3, 3)), np.empty(3)
    for i in range(first, last):
        w = weights[i]
        k = basis_at((times[i] - origin) / step, count, basis, slope)
        for a in range(3):
            side[a] = w * (rows[i, 0, a] * rights[i, 0] + rows[i, 1, a] * rights[i, 1])
            for b in range(3):
                normal[a, b] = w * (rows[i, 0, a] * rows[i, 0, b] + rows[i, 1, a] * rows[i, 1, b])
        for p in range(SPAN):
            at = 3 * (k + p)
            for a in range(3):
                z[at + a] += basis[p] * side[a]
                for q in range(p + 1):
                    scale = basis[p] * basis[q]
                    for b in range(3):
                        lag = 3 * (p - q) + a - b
                        if lag >= 0:
                            band[at + a, lag] += scale * normal[a, b]


@njit(cache=True, error_model="numpy")
def penalty_moments(z, inverse, out):
    """Add the sum of squared second differences, and the trace of their covariance, to `out`."""
    for i in range(len(z) - 6):
        d = z[i] - 2.0 * z[i + 3] + z[i + 6]
        out[0] += d * d
        out[1] += inverse[i, 0] + 4.0 * inverse[i + 3, 0] + inverse[i + 6, 0]
        out[1] += 2.0 * (inverse[i + 6, 6] - 2.0 * inverse[i + 3, 3] - 2.0 * inverse[i + 6, 3])


@njit(cache=True, error_model="numpy")
def add_clocks(sums, z, inverse, knots, rays, followed):
    """Add the information of the observations about the clocks.

    It is computed given the trajectory z and its inverse in the band. The right-hand side contains the
    residuals and the derivative of the trajectory's own evidence, -1/2 log |H|. Without this term, noise in
    the velocities would bias the clocks.
    """
    own, own_right, cross = sums
    first, last, origin, count, step = knots
    times, cameras, since, rows, rights, weights = rays
    positions, velocities, leverage = followed
    clocks = cross.shape[1] // 2
    basis, slope = np.empty(SPAN), np.empty(SPAN)
    spread, tilt = np.empty((3, 3)), np.empty((3, 3))
    d = np.empty(2)
    for i in range(first, last):
        w, c, tau = weights[i], cameras[i], since[i]
        k = basis_at((times[i] - origin) / step, count, basis, slope)
        spread[:], tilt[:] = 0.0, 0.0
        for p in range(SPAN):
            slope[p] /= step
            for a in range(3):
                positions[i, a] += basis[p] * z[3 * (k + p) + a]
                velocities[i, a] += slope[p] * z[3 * (k + p) + a]
        for p in range(SPAN):
            for q in range(SPAN):
                for a in range(3):
                    for b in range(3):
                        row, col = 3 * (k + p) + a, 3 * (k + q) + b
                        entry = inverse[row, row - col] if row >= col else inverse[col, col - row]
                        spread[a, b] += basis[p] * basis[q] * entry
                        tilt[a, b] += slope[p] * basis[q] * entry
        bend, misses = 0.0, 0.0
        for e in range(2):
            d[e], miss = 0.0, -rights[i, e]
            for a in range(3):
                d[e] += rows[i, e, a] * velocities[i, a]
                miss += rows[i, e, a] * positions[i, a]
                for b in range(3):
                    leverage[i] += w * rows[i, e, a] * spread[a, b] * rows[i, e, b]
                    bend += rows[i, e, a] * tilt[a, b] * rows[i, e, b]
            misses += d[e] * miss
        square = w * (d[0] * d[0] + d[1] * d[1])
        own[c, c] += square
        own[c, clocks + c] += tau * square
        own[clocks + c, c] += tau * square
        own[clocks + c, clocks + c] += tau * tau * square
        own_right[c] -= w * (misses + bend)
        own_right[clocks + c] -= tau * w * (misses + bend)
        for p in range(SPAN):
            for a in range(3):
                value = w * basis[p] * (rows[i, 0, a] * d[0] + rows[i, 1, a] * d[1])
                cross[3 * (k + p) + a, c] += value
                cross[3 * (k + p) + a, clocks + c] += tau * value
