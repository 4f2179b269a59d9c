"""Measurements that depend on the motion, for views with stamps of their own; compiled.

See `domain.TimeShift`: a position is measured as X + G V (X + G (V - u) with the assumed G u given back),
and the views say the velocity by themselves with some information.
"""
from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.refinement.kalman import cholesky, update_scalar, whiten, whitened_row


@njit(cache=True, error_model="numpy")
def start_moving(states, covariances, points, noises, delays, velocities, spreads):
    """States (N, 6) and covariances (N, 6, 6) of unknown points, in place, from X + G V = point.

    The velocities (N, 3) m/s have covariances `spreads` (N, 3, 3), independent of the noise of the points.
    Known states, and those whose point is NaN, stay.
    """
    for n in range(len(states)):
        if np.isfinite(states[n, 0]) or not np.isfinite(points[n, 0]):
            continue
        turned, moved = delays[n] @ spreads[n], delays[n] @ velocities[n]
        turned_back = turned @ delays[n].T
        for i in range(3):
            states[n, i], states[n, 3 + i] = points[n, i] - moved[i], velocities[n, i]
            for k in range(3):
                covariances[n, i, k] = noises[n, i, k] + turned_back[i, k]
                covariances[n, i, 3 + k] = covariances[n, 3 + k, i] = -turned[i, k]
                covariances[n, 3 + i, 3 + k] = spreads[n, i, k]


@njit(cache=True, error_model="numpy")
def update_moving(states, covariances, points, noises, delays, cauchy, innovations):
    """Update with X + G V = points (N, 3) of covariances (N, 3, 3), in place; NaN points change nothing.

    Cauchy weights and innovations as in `kalman.update_states`, which this is for delays G (N, 3, 3) of 0.
    """
    row, ahead, gain = np.empty(6), np.empty((3, 6)), np.empty(6)
    total, lower, innovation = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    for n in range(len(states)):
        if not np.isfinite(points[n, 0]):
            continue
        for i in range(3):
            for k in range(6):
                ahead[i, k] = covariances[n, i, k]
                for m in range(3):
                    ahead[i, k] += delays[n, i, m] * covariances[n, 3 + m, k]
        for i in range(3):
            innovation[i] = points[n, i] - states[n, i]
            for k in range(3):
                innovation[i] -= delays[n, i, k] * states[n, 3 + k]
                total[i, k] = noises[n, i, k] + ahead[i, k]
                for m in range(3):
                    total[i, k] += ahead[i, 3 + m] * delays[n, k, m]
        whiten(total, innovation, lower, innovations[n])
        squared = 0.0
        for i in range(3):
            squared += innovations[n, i] ** 2
        more, less = 1.0 + squared / 3.0 / (cauchy * cauchy), 1.0 + 1.0 / (cauchy * cauchy)
        for i in range(3):
            for k in range(3):
                total[i, k] = noises[n, i, k] * more / less
        cholesky(total, lower)
        for k in range(3):
            whitened_row(lower, k, row[:3])
            value = row[3] = row[4] = row[5] = 0.0
            for i in range(3):
                value += row[i] * points[n, i]
                for m in range(3):
                    row[3 + m] += row[i] * delays[n, i, m]
            _update_row(states[n], covariances[n], row, value, np.inf, gain)


@njit(cache=True, error_model="numpy")
def update_velocities(states, covariances, velocities, information, cauchy):
    """Update with velocities (N, 3) m/s of inverse covariances (N, 3, 3), maybe singular, in place.

    Unknown states and information of 0 change nothing.
    """
    row, gain, lower = np.zeros(6), np.empty(6), np.empty((3, 3))
    for n in range(len(states)):
        scale = information[n, 0, 0] + information[n, 1, 1] + information[n, 2, 2]
        if not (np.isfinite(states[n, 0]) and scale > 0.0):
            continue
        cholesky(information[n], lower)
        lower[0, 1] = lower[0, 2] = lower[1, 2] = 0.0
        for k in range(3):
            value = 0.0
            for i in range(3):
                row[3 + i] = lower[i, k]
                value += lower[i, k] * velocities[n, i]
            _update_row(states[n], covariances[n], row, value, cauchy, gain)


@njit(cache=True, error_model="numpy")
def _update_row(state, covariance, row, value, cauchy, gain):
    """Update with row . state = value of noise 1, in place, with a Cauchy weight; gain (6,) is scratch."""
    expected, innovation = 0.0, value
    for i in range(6):
        gain[i] = 0.0
        for k in range(6):
            gain[i] += covariance[i, k] * row[k]
    for k in range(6):
        expected += row[k] * gain[k]
        innovation -= row[k] * state[k]
    weight = 1.0 / (cauchy * cauchy)
    noise = (1.0 + weight * innovation**2 / (expected + 1.0)) / (1.0 + weight)
    update_scalar(state, covariance, gain, innovation, expected + noise)
