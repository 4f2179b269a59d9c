"""Kalman filter and Rauch-Tung-Striebel smoother of points with full covariances, compiled.

State of each point: position m and velocity m/s (6), covariance (6, 6). White acceleration of
spectral density q: Q = q [[dt^3/3, dt^2/2], [dt^2/2, dt]] on each axis, so results do not depend on
the frame rate.
"""
from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy")
def predict_states(states, covariances, dt, q):
    """States (N, 6) and covariances (N, 6, 6) dt s later, under noise q (N,); NaN rows stay NaN."""
    count = len(states)
    moved, grown = states.copy(), covariances.copy()
    for n in range(count):
        for i in range(3):
            moved[n, i] += dt * states[n, 3 + i]
        p = covariances[n]
        for i in range(3):
            for k in range(3):
                grown[n, i, k] = p[i, k] + dt * (p[i, 3 + k] + p[3 + i, k]) + dt * dt * p[3 + i, 3 + k]
                grown[n, i, 3 + k] = p[i, 3 + k] + dt * p[3 + i, 3 + k]
                grown[n, 3 + k, i] = grown[n, i, 3 + k]
            grown[n, i, i] += q[n] * dt**3 / 3.0
            grown[n, i, 3 + i] += q[n] * dt**2 / 2.0
            grown[n, 3 + i, i] += q[n] * dt**2 / 2.0
            grown[n, 3 + i, 3 + i] += q[n] * dt
    return moved, grown


@njit(cache=True, error_model="numpy")
def update_states(states, covariances, points, noises, cauchy, innovations):
    """Take points (N, 3) with covariances (N, 3, 3), in place; NaN points change nothing.

    innovations (N, 3) becomes what was not expected, whitened, where a point is taken.

    A surprise of m sigmas multiplies the noise by 1 + (m / cauchy)^2 (the weight of a Cauchy
    likelihood), divided by what that is on average, so that covariances stay honest. The three
    coordinates are taken one after another after whitening the noise.
    """
    for n in range(len(states)):
        if not np.isfinite(points[n, 0]):
            continue
        total = covariances[n, :3, :3] + noises[n]
        surprise = points[n] - states[n, :3]
        whiten(total, surprise, innovations[n])
        squared = (innovations[n] ** 2).sum() / 3.0
        noise = noises[n] * (1.0 + squared / (cauchy * cauchy)) / (1.0 + 1.0 / (cauchy * cauchy))
        lower = cholesky(noise)
        for k in range(3):  # row k of lower^-1 is the k-th whitened measurement of noise 1
            row = np.zeros(3)
            row[k] = 1.0
            for i in range(k, -1, -1):  # solve lower^T r = e_k
                value = row[i]
                for m in range(i + 1, k + 1):
                    value -= lower[m, i] * row[m]
                row[i] = value / lower[i, i]
            _scalar_update(states[n], covariances[n], row, points[n])


@njit(cache=True, error_model="numpy")
def _scalar_update(state, covariance, row, point):
    """One measurement row . position = row . point of noise 1."""
    gain = np.zeros(6)
    spread, surprise = 1.0, 0.0
    for i in range(6):
        for k in range(3):
            gain[i] += covariance[i, k] * row[k]
    for k in range(3):
        spread += row[k] * gain[k]
        surprise += row[k] * (point[k] - state[k])
    for i in range(6):
        state[i] += gain[i] * surprise / spread
    for i in range(6):
        for k in range(i + 1):
            covariance[i, k] -= gain[i] * gain[k] / spread
            covariance[k, i] = covariance[i, k]


@njit(cache=True, error_model="numpy")
def cholesky(matrix):
    """Lower factor of a symmetric positive matrix, with a floor on the pivots."""
    size = len(matrix)
    lower = np.zeros((size, size))
    for i in range(size):
        for k in range(i + 1):
            value = matrix[i, k]
            for m in range(k):
                value -= lower[i, m] * lower[k, m]
            if i == k:
                lower[i, i] = np.sqrt(max(value, 1e-16))
            else:
                lower[i, k] = value / lower[k, k]
    return lower


@njit(cache=True, error_model="numpy")
def whiten(matrix, vector, result):
    """result = lower^-1 vector with lower lower^T = matrix."""
    lower = cholesky(matrix)
    for i in range(len(vector)):
        value = vector[i]
        for m in range(i):
            value -= lower[i, m] * result[m]
        result[i] = value / lower[i, i]


@njit(cache=True, error_model="numpy")
def smooth_states(states, covariances, dt, predicted, predicted_covariances, later, later_covariances):
    """One step backwards: smoothed states (N, 6) and covariances (N, 6, 6).

    Args:
        states, covariances: filtered, at this instant. dt: s to the next one.
        predicted, predicted_covariances: of the next instant, from this one.
        later, later_covariances: smoothed, of the next instant.
    """
    count = len(states)
    smoothed, tightened = states.copy(), covariances.copy()
    for n in range(count):
        if not np.isfinite(later[n, 0] + states[n, 0] + predicted[n, 0]):
            continue  # unknown here or later, or started anew in between
        lower = cholesky(predicted_covariances[n])
        cross = covariances[n].copy()  # P F^T
        for i in range(6):
            for k in range(3):
                cross[i, k] += dt * covariances[n, i, 3 + k]
        gain = np.empty((6, 6))
        for i in range(6):
            gain[i] = _solve(lower, cross[i])
        change = later_covariances[n] - predicted_covariances[n]
        for i in range(6):
            for k in range(6):
                smoothed[n, i] += gain[i, k] * (later[n, k] - predicted[n, k])
        half = np.zeros((6, 6))
        for i in range(6):
            for k in range(6):
                for m in range(6):
                    half[i, k] += gain[i, m] * change[m, k]
        for i in range(6):
            for k in range(6):
                for m in range(6):
                    tightened[n, i, k] += half[i, m] * gain[k, m]
    return smoothed, tightened


@njit(cache=True, error_model="numpy")
def _solve(lower, right):
    """Solution of lower lower^T x = right."""
    size = len(right)
    x = right.copy()
    for i in range(size):
        for m in range(i):
            x[i] -= lower[i, m] * x[m]
        x[i] /= lower[i, i]
    for i in range(size - 1, -1, -1):
        for m in range(i + 1, size):
            x[i] -= lower[m, i] * x[m]
        x[i] /= lower[i, i]
    return x


@njit(cache=True, error_model="numpy")
def raise_speeds(speeds, states, top):
    """speeds (J,) m/s at least those of the joints (J, 6) against the body, at most `top`, in place.

    The body moves with the median velocity of the joints.
    """
    known = np.isfinite(states[:, 3])
    if not known.any():
        return
    body = np.empty(3)
    for i in range(3):
        body[i] = np.median(states[known, 3 + i])
    for j in range(len(speeds)):
        if known[j]:
            against = 0.0
            for i in range(3):
                against += (states[j, 3 + i] - body[i]) ** 2
            speeds[j] = max(speeds[j], min(np.sqrt(against), top))
