"""Kalman filter and Rauch-Tung-Striebel smoother of all joints of all people, compiled.

State of each joint: position m and velocity m/s (6), covariance (6, 6). White acceleration of
spectral density q: Q = q [[dt^3/3, dt^2/2], [dt^2/2, dt]] on each axis, so results do not depend on
the frame rate.
"""
from __future__ import annotations

import numpy as np

from panoptic_ros.geometry.robust import relative_growth
from panoptic_ros.kernels import njit
from panoptic_ros.refinement.small_matrices import cholesky, solve, whiten, whitened_row


@njit(cache=True, error_model="numpy")
def predict(motion, dt, noise, ahead):
    """ahead becomes the motion dt s later under process noise (P, J) m^2/s^3."""
    for p, j in np.ndindex(noise.shape):
        state, cov, q = motion.states[p, j], motion.covariances[p, j], noise[p, j]
        moved, grown = ahead.states[p, j], ahead.covariances[p, j]
        for i in range(3):
            moved[i], moved[3 + i] = state[i] + dt * state[3 + i], state[3 + i]
            for k in range(3):
                grown[i, k] = cov[i, k] + dt * (cov[i, 3 + k] + cov[3 + i, k])
                grown[i, k] += dt * dt * cov[3 + i, 3 + k]
                grown[i, 3 + k] = grown[3 + k, i] = cov[i, 3 + k] + dt * cov[3 + i, 3 + k]
                grown[3 + i, 3 + k] = cov[3 + i, 3 + k]
            grown[i, i] += q * dt**3 / 3.0
            grown[i, 3 + i] += q * dt**2 / 2.0
            grown[3 + i, i] += q * dt**2 / 2.0
            grown[3 + i, 3 + i] += q * dt


@njit(cache=True, error_model="numpy")
def update(motion, rows, points, noises, cauchy, innovations):
    """Update the people of these rows (R,) with points (R, J, 3) m, in place.

    Points that are NaN, and joints whose motion is unknown, change nothing.

    Large innovations multiply the noise (`geometry.robust`). The three coordinates are taken one after
    another after whitening the noise.

    Args:
        noises: (P, J, 3, 3) m^2, covariances of the points. innovations: (P, J, 3) becomes the whitened
            innovation (measured minus predicted) where a point is used.
    """
    total, lower, innovation = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    row, gain, softness = np.empty(6), np.empty(6), 1.0 / (cauchy * cauchy)
    for r, j in np.ndindex(points.shape[:2]):
        state, cov = motion.states[rows[r], j], motion.covariances[rows[r], j]
        noise, whitened = noises[rows[r], j], innovations[rows[r], j]
        if not np.isfinite(points[r, j, 0] + state[0]):
            continue
        for i in range(3):
            innovation[i] = points[r, j, i] - state[i]
            for k in range(3):
                total[i, k] = cov[i, k] + noise[i, k]
        cholesky(total, lower, False)
        whiten(lower, innovation, whitened)
        squared = 0.0
        for i in range(3):
            squared += whitened[i] ** 2 / 3.0
        growth = relative_growth(squared, softness)
        for i in range(3):
            for k in range(3):
                total[i, k] = noise[i, k] * growth
        cholesky(total, lower, False)
        for k in range(3):  # row k of lower^-1 is the k-th whitened measurement of noise 1
            whitened_row(lower, k, row)
            value = 0.0
            for i in range(3):
                value += row[i] * (points[r, j, i] - state[i])
            update_row(state, cov, row, value, np.inf, gain)


@njit(cache=True, error_model="numpy")
def update_row(state, covariance, row, innovation, cauchy, gain):
    """Update with one row (6,) of the measurement matrix, of noise 1, with a Cauchy weight; gain: scratch."""
    spread, softness = 0.0, 1.0 / (cauchy * cauchy)
    for i in range(6):
        gain[i] = 0.0
        for k in range(6):
            gain[i] += covariance[i, k] * row[k]
    for k in range(6):
        spread += row[k] * gain[k]
    spread += relative_growth(innovation**2 / (spread + 1.0), softness)
    scaled = innovation / spread
    for i in range(6):
        state[i] += gain[i] * scaled
        for k in range(i + 1):
            covariance[i, k] -= gain[i] * gain[k] / spread
            covariance[k, i] = covariance[i, k]


@njit(cache=True, error_model="numpy")
def smoother_gains(motion, dt, ahead, gains):
    """gains (P, J, 6, 6), transposed, become (covariance ahead)^-1 F P, from dt s ahead back to now."""
    lower = np.empty((6, 6))
    for p, j in np.ndindex(gains.shape[:2]):
        cov, gain = motion.covariances[p, j], gains[p, j]
        for k in range(3):
            for i in range(6):
                gain[k, i], gain[3 + k, i] = cov[i, k] + dt * cov[i, 3 + k], cov[i, 3 + k]
        solve(ahead.covariances[p, j], gain, lower)


@njit(cache=True, error_model="numpy")
def smooth(motion, gains, predicted, measured, later, again):
    """One step backwards: later, smoothed, becomes the smoothed motion of this instant, in place.

    Args:
        motion: filtered, at this instant. predicted: of the next instant, from this one.
        measured: (P, J) joints that are, at the next instant. again: (P, J) those that are later,
            becomes those that are after this instant, without an interruption.
    """
    half, change, difference = np.empty(6), np.empty(6), np.empty((6, 6))
    for p, j in np.ndindex(again.shape):
        state, cov, gain = motion.states[p, j], motion.covariances[p, j], gains[p, j]
        ahead, ahead_cov = predicted.states[p, j], predicted.covariances[p, j]
        out, out_cov = later.states[p, j], later.covariances[p, j]
        again[p, j] = (again[p, j] or measured[p, j]) and np.isfinite(ahead[0])
        known = np.isfinite(out[0] + state[0] + ahead[0])  # here and later, with no start in between
        for i in range(6):
            change[i] = out[i] - ahead[i]
            out[i] = state[i]
            for k in range(6):
                difference[i, k] = out_cov[i, k] - ahead_cov[i, k]
                out_cov[i, k] = cov[i, k]
        for i in range(6 if known else 0):
            for k in range(6):
                out[i] += gain[k, i] * change[k]
                half[k] = 0.0
                for m in range(6):
                    half[k] += gain[m, i] * difference[m, k]
            for k in range(i + 1):
                value = 0.0
                for m in range(6):
                    value += half[m] * gain[m, k]
                out_cov[i, k] = out_cov[k, i] = cov[i, k] + value
