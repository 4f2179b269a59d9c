"""Kalman filter and Rauch-Tung-Striebel smoother of all joints of all people, compiled.

State of each joint: position m, velocity m/s and, by some models, acceleration m/s^2 (S = 6 or 9), covariance
(S, S). A `motion_model.Transition` tells how it goes on, the same on each axis.
"""
from __future__ import annotations

import numpy as np

from panoptic_ros.geometry.robust import relative_growth
from panoptic_ros.kernels import njit
from panoptic_ros.refinement.motion_model import MOVING, NINE, SIX
from panoptic_ros.refinement.small_matrices import cholesky, solve, whiten, whitened_row


@njit(cache=True, error_model="numpy")
def predict(motion, transition, noise, ahead):
    """ahead becomes the motion after a transition under process noise (P, J) m^2/s^3."""
    if motion.states.shape[2] == MOVING:
        _predict(SIX, motion, transition, noise, ahead)
    else:
        _predict(NINE, motion, transition, noise, ahead)


@njit(cache=True, error_model="numpy")
def _predict(sized, motion, transition, noise, ahead):
    """`predict` of states of a size that is known when it is compiled, as all that begins with `sized`."""
    size, orders, forward, spread = len(sized), len(sized) // 3, transition.forward, transition.spread
    half = np.empty((size, size))
    for p, j in np.ndindex(noise.shape):
        state, cov, q = motion.states[p, j], motion.covariances[p, j], noise[p, j]
        moved, grown = ahead.states[p, j], ahead.covariances[p, j]
        carried(sized, forward, cov, half)
        for a in range(orders):
            for i in range(3):
                moved[3 * a + i] = 0.0
                for m in range(a, orders):
                    moved[3 * a + i] += forward[a, m] * state[3 * m + i]
                for b in range(orders):
                    for k in range(3):
                        value = 0.0
                        for m in range(b, orders):
                            value += forward[b, m] * half[3 * a + i, 3 * m + k]
                        grown[3 * a + i, 3 * b + k] = value
                    grown[3 * a + i, 3 * b + i] += q * spread[a, b]


@njit(cache=True, error_model="numpy")
def carried(sized, forward, matrix, result):
    """result (S, S) = F matrix, for the upper triangle F that is `forward` (S / 3, S / 3) on each axis."""
    for a in range(len(sized) // 3):
        for i in range(3):
            for k in range(len(sized)):
                value = forward[a, a] * matrix[3 * a + i, k]
                for m in range(a + 1, len(sized) // 3):
                    value += forward[a, m] * matrix[3 * m + i, k]
                result[3 * a + i, k] = value


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
    if motion.states.shape[2] == MOVING:
        _update(SIX, motion, rows, points, noises, cauchy, innovations)
    else:
        _update(NINE, motion, rows, points, noises, cauchy, innovations)


@njit(cache=True, error_model="numpy")
def _update(sized, motion, rows, points, noises, cauchy, innovations):
    total, lower, innovation = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    row, gain, softness = np.empty(3), np.empty(len(sized)), 1.0 / (cauchy * cauchy)
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
            _update_row(sized, state, cov, row, value, np.inf, gain)


@njit(cache=True, error_model="numpy")
def update_row(state, covariance, row, innovation, cauchy, gain):
    """Update with one row of the measurement matrix, of noise 1, with a Cauchy weight; gain: scratch.

    row: (S,), or fewer if all others are 0.
    """
    if len(state) == MOVING:
        _update_row(SIX, state, covariance, row, innovation, cauchy, gain)
    else:
        _update_row(NINE, state, covariance, row, innovation, cauchy, gain)


@njit(cache=True, error_model="numpy")
def _update_row(sized, state, covariance, row, innovation, cauchy, gain):
    size, spread, softness = len(sized), 0.0, 1.0 / (cauchy * cauchy)
    for i in range(size):
        gain[i] = 0.0
        for k in range(len(row)):
            gain[i] += covariance[i, k] * row[k]
    for k in range(len(row)):
        spread += row[k] * gain[k]
    spread += relative_growth(innovation**2 / (spread + 1.0), softness)
    scaled = innovation / spread
    for i in range(size):
        state[i] += gain[i] * scaled
        for k in range(i + 1):
            covariance[i, k] -= gain[i] * gain[k] / spread
            covariance[k, i] = covariance[i, k]


@njit(cache=True, error_model="numpy")
def smoother_gains(motion, transition, ahead, gains):
    """gains (P, J, S, S), transposed, become (covariance ahead)^-1 F P, from ahead back over a transition."""
    if gains.shape[2] == MOVING:
        _gains(SIX, motion, transition, ahead, gains)
    else:
        _gains(NINE, motion, transition, ahead, gains)


@njit(cache=True, error_model="numpy")
def _gains(sized, motion, transition, ahead, gains):
    lower = np.empty((len(sized), len(sized)))
    for p, j in np.ndindex(gains.shape[:2]):
        carried(sized, transition.forward, motion.covariances[p, j], gains[p, j])
        solve(sized, ahead.covariances[p, j], gains[p, j], lower)


@njit(cache=True, error_model="numpy")
def smooth(motion, gains, predicted, measured, later, again):
    """One step backwards: later, smoothed, becomes the smoothed motion of this instant, in place.

    Args:
        motion: filtered, at this instant. predicted: of the next instant, from this one.
        measured: (P, J) joints that are, at the next instant. again: (P, J) those that are later,
            becomes those that are after this instant, without an interruption.
    """
    if motion.states.shape[2] == MOVING:
        _smooth(SIX, motion, gains, predicted, measured, later, again)
    else:
        _smooth(NINE, motion, gains, predicted, measured, later, again)


@njit(cache=True, error_model="numpy")
def _smooth(sized, motion, gains, predicted, measured, later, again):
    size = len(sized)
    half, change, difference = np.empty(size), np.empty(size), np.empty((size, size))
    for p, j in np.ndindex(again.shape):
        state, cov, gain = motion.states[p, j], motion.covariances[p, j], gains[p, j]
        ahead, ahead_cov = predicted.states[p, j], predicted.covariances[p, j]
        out, out_cov = later.states[p, j], later.covariances[p, j]
        again[p, j] = (again[p, j] or measured[p, j]) and np.isfinite(ahead[0])
        known = np.isfinite(out[0] + state[0] + ahead[0])  # here and later, with no start in between
        for i in range(size):
            change[i] = out[i] - ahead[i]
            out[i] = state[i]
            for k in range(size):
                difference[i, k] = out_cov[i, k] - ahead_cov[i, k]
                out_cov[i, k] = cov[i, k]
        for i in range(size if known else 0):
            for k in range(size):
                out[i] += gain[k, i] * change[k]
                half[k] = 0.0
                for m in range(size):
                    half[k] += gain[m, i] * difference[m, k]
            for k in range(i + 1):
                value = 0.0
                for m in range(size):
                    value += half[m] * gain[m, k]
                out_cov[i, k] = out_cov[k, i] = cov[i, k] + value
