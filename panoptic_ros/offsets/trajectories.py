"""Kernel: the trajectory of every joint through all its rays, and what it says about the clocks.

A trajectory is a uniform cubic B-spline with a penalty on its second differences, the prior of white
acceleration. Observation i at the corrected time t_i is the linear pair of rows A_i X(t_i) = b_i. Moving the
clock of its camera by do changes the residual by d_i do with d_i = A_i X'(t_i). Eliminating the spline
(banded Cholesky) leaves a small system for the clocks.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.offsets.banded import backward, factor, forward, inverse_in_band

SPAN = 4  # control points that act at an instant
WIDTH = 3 * SPAN  # band of three coordinates


class SeriesFit(NamedTuple):
    """S trajectories fitted to N observations, given the clocks of C cameras.

    information: (2C, 2C) and right: (2C,), the right-hand side, of the clocks' offsets and drifts.
    positions, velocities: (N, 3). leverage: (N,) share of an observation that its trajectory follows.
    rough: (S, 2) sum of squared second differences, and the trace of their covariance.
    """

    information: np.ndarray
    right: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray
    leverage: np.ndarray
    rough: np.ndarray


@njit(cache=True, error_model="numpy")
def basis_at(place, count, basis, slope):
    """Weights (4,) of control points at `place` (in knots) and their derivatives; the first one's index."""
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
def fit_series(starts, origins, counts, step, stiffness, times, cameras, since, rows, rights, weights,
               cameras_count):  # fmt: skip
    """Fit all trajectories.

    Args:
        starts: (S + 1,) first observation of each series. origins: (S,) s. counts: (S,) control points.
        step: s between knots. stiffness: (S,) penalty on squared second differences.
        times: (N,) s, corrected. cameras: (N,). since: (N,) s from the reference instant of the clocks.
        rows: (N, 2, 3), rights: (N, 2), in units of the noise. weights: (N,).
    """
    series = len(counts)
    unknowns = 2 * cameras_count
    information, right = np.zeros((unknowns, unknowns)), np.zeros(unknowns)
    total = len(times)
    positions, velocities = np.zeros((total, 3)), np.zeros((total, 3))
    leverage, rough = np.zeros(total), np.zeros((series, 2))
    own = np.empty((unknowns, unknowns))
    for s in range(series):
        n = 3 * counts[s]
        band, z = np.zeros((n, WIDTH)), np.zeros(n)
        add_penalty(band, stiffness[s])
        add_observations(band, z, starts[s], starts[s + 1], origins[s], counts[s], step, times, rows, rights,
                         weights)  # fmt: skip
        if not factor(band):
            continue
        column = z.reshape(n, 1)
        forward(band, column)
        backward(band, z)
        inverse = inverse_in_band(band)
        penalty_moments(z, inverse, rough[s])
        cross = np.zeros((n, unknowns))
        own[:] = 0.0
        add_clocks(own, right, cross, z, inverse, starts[s], starts[s + 1], origins[s], counts[s], step,
                   times, cameras, since, rows, rights, weights, positions, velocities, leverage)  # fmt: skip
        forward(band, cross)
        information += own - cross.T @ cross
    return SeriesFit(information, right, positions, velocities, leverage, rough)


@njit(cache=True, error_model="numpy")
def add_penalty(band, stiffness):
    """The penalty on second differences of the control points, and a trace of ridge."""
    n = len(band)
    for i in range(n):
        band[i, 0] += 1e-9 * stiffness
    for i in range(0, n - 6):  # coordinate i % 3 of control points i // 3 and the next two
        band[i, 0] += stiffness
        band[i + 3, 0] += 4.0 * stiffness
        band[i + 6, 0] += stiffness
        band[i + 3, 3] -= 2.0 * stiffness
        band[i + 6, 3] -= 2.0 * stiffness
        band[i + 6, 6] += stiffness


@njit(cache=True, error_model="numpy")
def add_observations(band, z, first, last, origin, count, step, times, rows, rights,
                     weights):  # fmt: skip
    """Normal equations of the observations first..last."""
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
    """Sum of squared second differences, and the trace of their covariance."""
    for i in range(len(z) - 6):
        d = z[i] - 2.0 * z[i + 3] + z[i + 6]
        out[0] += d * d
        out[1] += inverse[i, 0] + 4.0 * inverse[i + 3, 0] + inverse[i + 6, 0]
        out[1] += 2.0 * (inverse[i + 6, 6] - 2.0 * inverse[i + 3, 3] - 2.0 * inverse[i + 6, 3])


@njit(cache=True, error_model="numpy")
def add_clocks(own, own_right, cross, z, inverse, first, last, origin, count, step, times, cameras, since,
               rows, rights, weights, positions, velocities, leverage):  # fmt: skip
    """What the observations say about the clocks, given the trajectory.

    The right-hand side carries, besides the residuals, the derivative of the trajectory's own evidence
    -1/2 log |H|: without it noise in the velocities pulls the clocks.
    """
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
