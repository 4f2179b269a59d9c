"""Kalman filter and Rauch-Tung-Striebel smoother of points with full covariances, compiled.

State of each point: position m and velocity m/s (6), covariance (6, 6). White acceleration of
spectral density q: Q = q [[dt^3/3, dt^2/2], [dt^2/2, dt]] on each axis, so results do not depend on
the frame rate.
"""
from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.kernels.order import median


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
    """Update with measured points (N, 3) of covariances (N, 3, 3), in place; NaN points change nothing.

    innovations (N, 3) becomes the whitened innovation (measured minus predicted) where a point is used.

    An innovation of m sigmas multiplies the noise by 1 + (m / cauchy)^2 (the weight of a Cauchy
    likelihood), divided by what that is on average, so that covariances stay honest. The three
    coordinates are taken one after another after whitening the noise.
    """
    total, lower = np.empty((3, 3)), np.empty((3, 3))
    innovation, row, gain = np.empty(3), np.empty(3), np.empty(6)
    softness = 1.0 / (cauchy * cauchy)
    for n in range(len(states)):
        if not np.isfinite(points[n, 0]):
            continue
        for i in range(3):
            innovation[i] = points[n, i] - states[n, i]
            for k in range(3):
                total[i, k] = covariances[n, i, k] + noises[n, i, k]
        whiten(total, innovation, lower, innovations[n])
        squared = 0.0
        for i in range(3):
            squared += innovations[n, i] ** 2 / 3.0
        weight = (1.0 + squared * softness) / (1.0 + softness)
        for i in range(3):
            for k in range(3):
                total[i, k] = noises[n, i, k] * weight
        cholesky(total, lower)
        for k in range(3):  # row k of lower^-1 is the k-th whitened measurement of noise 1
            whitened_row(lower, k, row)
            value = spread = 0.0
            for i in range(3):
                value += row[i] * (points[n, i] - states[n, i])
            for i in range(6):
                gain[i] = 0.0
                for m in range(3):
                    gain[i] += covariances[n, i, m] * row[m]
            for i in range(3):
                spread += row[i] * gain[i]
            update_scalar(states[n], covariances[n], gain, value, spread + 1.0)


@njit(cache=True, error_model="numpy")
def whitened_row(lower, k, row):
    """row = row k of lower^-1, the solution r of lower^T r = e_k."""
    for i in range(len(row)):
        row[i] = 1.0 if i == k else 0.0
    for i in range(k, -1, -1):
        value = row[i]
        for m in range(i + 1, k + 1):
            value -= lower[m, i] * row[m]
        row[i] = value / lower[i, i]


@njit(cache=True, error_model="numpy")
def update_scalar(state, covariance, gain, innovation, spread):
    """Update with one scalar measurement, in place.

    Args:
        gain: (6,) the covariance times the measurement's row. spread: variance of the innovation.
    """
    scaled = innovation / spread
    for i in range(6):
        state[i] += gain[i] * scaled
        for k in range(i + 1):
            covariance[i, k] -= gain[i] * gain[k] / spread
            covariance[k, i] = covariance[i, k]


@njit(cache=True, error_model="numpy")
def cholesky(matrix, lower):
    """lower lower^T = matrix, positive, with a floor on the pivots; nothing is written above the diagonal."""
    for i in range(len(matrix)):
        for k in range(i + 1):
            value = matrix[i, k]
            for m in range(k):
                value -= lower[i, m] * lower[k, m]
            lower[i, k] = np.sqrt(max(value, 1e-16)) if i == k else value / lower[k, k]


@njit(cache=True, error_model="numpy")
def whiten(matrix, vector, lower, result):
    """result = lower^-1 vector with lower lower^T = matrix."""
    cholesky(matrix, lower)
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
    lower, gain, half = np.empty((6, 6)), np.empty((6, 6)), np.empty((6, 6))
    for n in range(count):
        if not np.isfinite(later[n, 0] + states[n, 0] + predicted[n, 0]):
            continue  # unknown here or later, or started anew in between
        _factorise(predicted_covariances[n], lower)
        for i in range(6):  # gain = P F^T (predicted covariance)^-1, row by row
            for k in range(6):
                gain[i, k] = covariances[n, i, k]
            for k in range(3):
                gain[i, k] += dt * covariances[n, i, 3 + k]
            _solve(lower, gain[i])
        for i in range(6):
            for k in range(6):
                smoothed[n, i] += gain[i, k] * (later[n, k] - predicted[n, k])
                half[i, k] = 0.0
            for m in range(6):
                for k in range(6):
                    half[i, k] += gain[i, m] * (later_covariances[n, m, k] - predicted_covariances[n, m, k])
        for i in range(6):
            for k in range(i + 1):
                value = 0.0
                for m in range(6):
                    value += half[i, m] * gain[k, m]
                tightened[n, i, k] += value
                tightened[n, k, i] = tightened[n, i, k]
    return smoothed, tightened


@njit(cache=True, error_model="numpy")
def _solve(lower, x):
    """x becomes the solution of lower lower^T y = x; the diagonal of lower is inverted."""
    size = len(x)
    for i in range(size):
        for m in range(i):
            x[i] -= lower[i, m] * x[m]
        x[i] *= lower[i, i]
    for i in range(size - 1, -1, -1):
        for m in range(i + 1, size):
            x[i] -= lower[m, i] * x[m]
        x[i] *= lower[i, i]


@njit(cache=True, error_model="numpy")
def _factorise(matrix, lower):
    """Like `cholesky`, in place, with the diagonal inverted."""
    for i in range(len(matrix)):
        for k in range(i + 1):
            value = matrix[i, k]
            for m in range(k):
                value -= lower[i, m] * lower[k, m]
            lower[i, k] = 1.0 / np.sqrt(max(value, 1e-16)) if i == k else value * lower[k, k]


@njit(cache=True, error_model="numpy")
def raise_speeds(speeds, states, top):
    """speeds (J,) m/s at least those of the joints (J, 6) against the body, at most `top`, in place.

    The body moves with the median velocity of the joints.
    """
    body, some, count = np.empty(3), np.empty(len(states)), 0
    for i in range(3):
        count = 0
        for j in range(len(states)):
            if np.isfinite(states[j, 3]):
                some[count] = states[j, 3 + i]
                count += 1
        if not count:
            return
        body[i] = median(some[:count])
    for j in range(len(speeds)):
        if np.isfinite(states[j, 3]):
            against = 0.0
            for i in range(3):
                against += (states[j, 3 + i] - body[i]) ** 2
            speeds[j] = max(speeds[j], min(np.sqrt(against), top))
