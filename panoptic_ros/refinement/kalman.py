"""Kalman filter and Rauch-Tung-Striebel smoother for all joints of all people; compiled.

The state of each joint has position m, velocity m/s and, in one of two models, acceleration m/s^2 (S = 6 or
9), with a covariance (S, S). A `motion_model.StateTransition` propagates it, equally on each axis. The
argument `sized` has length S, because kernels are compiled for each size.

If views have different timestamps, measurements depend on the velocity V (see `domain.TimeShift`). The stated
position is X + G (V - u) with the assumed velocity u. Callers add G u, so that the position measures X + G V.
The views also measure the velocity itself, with some information.
"""

from __future__ import annotations

import numpy as np

from panoptic_ros.geometry.robust import relative_growth
from panoptic_ros.kernels import njit
from panoptic_ros.refinement.small_matrices import cholesky, solve, whiten, whitened_row


@njit(cache=True, error_model="numpy")
def predict(sized, motion, transition, noise, ahead):
    """Write the motion after a transition under process noise (P, J) m^2/s^3 to `ahead`."""
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
    """Write the product of F and a matrix, both (S, S), to `result`.

    F is upper triangular and acts as `forward` (S / 3, S / 3) on each axis.
    """
    for a in range(len(sized) // 3):
        for i in range(3):
            for k in range(len(sized)):
                value = forward[a, a] * matrix[3 * a + i, k]
                for m in range(a + 1, len(sized) // 3):
                    value += forward[a, m] * matrix[3 * m + i, k]
                result[3 * a + i, k] = value


@njit(cache=True, error_model="numpy")
def update(sized, motion, rows, measured, cauchy, innovations):
    """Update `motion` of the people in these rows (R,) with measured points (R, J, 3) m.

    Joints with a NaN point or an unknown state stay unchanged. Large innovations increase the noise
    (`geometry.robust`). The noise is whitened, then the three coordinates are applied one after another.

    Args:
        rows: (R,) rows of the people.
        measured: Tuple of points (R, J, 3) m, noises (P, J, 3, 3) m^2 and delays (R, J, 3, 3) s. The noises
            are covariances of the points. Points measure X + G V with the delays G, or X if the delays are
            empty (0, J, 3, 3).
        cauchy: Scale of the Cauchy weight, in standard deviations.
        innovations: (P, J, 3), output: whitened innovations (measured minus predicted) of the used points.
    """
    points, noises, delays = measured
    size, moving = len(sized), len(delays) > 0
    row, ahead, gain = np.zeros(6 if moving else 3), np.empty((3, size)), np.empty(size)
    total, lower, innovation = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    for r, j in np.ndindex(points.shape[:2]):
        state, cov = motion.states[rows[r], j], motion.covariances[rows[r], j]
        noise, whitened = noises[rows[r], j], innovations[rows[r], j]
        if not np.isfinite(points[r, j, 0] + state[0]):
            continue
        for i in range(3):
            innovation[i] = points[r, j, i] - state[i]
            for k in range(3):
                total[i, k] = cov[i, k] + noise[i, k]
        if moving:
            _delay(delays[r, j], state, cov, ahead, innovation, total)
        cholesky(total, lower, False)
        whiten(lower, innovation, whitened)
        squared = 0.0
        for i in range(3):
            squared += whitened[i] ** 2 / 3.0
        growth = relative_growth(squared, cauchy)
        for i in range(3):
            for k in range(3):
                total[i, k] = noise[i, k] * growth
        cholesky(total, lower, False)
        for k in range(3):  # row k of lower^-1 is the k-th whitened measurement of noise 1
            whitened_row(lower, k, row[:3])
            row[3:] = 0.0
            value = 0.0
            for i in range(3):
                value += row[i] * (points[r, j, i] - state[i])
                for m in range(3 if moving else 0):
                    row[3 + m] += row[i] * delays[r, j, i, m]
            for m in range(3, len(row)):
                value -= row[m] * state[m]
            update_row(sized, state, cov, row, value, np.inf, gain)


@njit(cache=True, error_model="numpy")
def _delay(delay, state, cov, ahead, innovation, total):
    """Change `innovation` (3,) and `total` (3, 3), its covariance, from those of X to those of X + G V.

    Args:
        ahead: (3, S), scratch.
    """
    for i in range(3):
        for k in range(3):
            innovation[i] -= delay[i, k] * state[3 + k]
        for k in range(6):
            ahead[i, k] = cov[i, k]
            for m in range(3):
                ahead[i, k] += delay[i, m] * cov[3 + m, k]
    for i in range(3):
        for k in range(3):
            total[i, k] += ahead[i, k] - cov[i, k]
            for m in range(3):
                total[i, k] += ahead[i, 3 + m] * delay[k, m]


@njit(cache=True, error_model="numpy")
def update_velocities(sized, motion, rows, velocities, information, cauchy):
    """Update `motion` with velocities (R, J, 3) m/s and their information (R, J, 3, 3) s^2/m^2.

    The information may be singular. Joints with zero information or an unknown state stay unchanged.
    """
    row, gain, lower = np.zeros(6), np.empty(len(sized)), np.empty((3, 3))
    for r, j in np.ndindex(velocities.shape[:2]):
        state, cov = motion.states[rows[r], j], motion.covariances[rows[r], j]
        scale = information[r, j, 0, 0] + information[r, j, 1, 1] + information[r, j, 2, 2]
        if not (np.isfinite(state[0]) and scale > 0.0):
            continue
        cholesky(information[r, j], lower, False)
        for k in range(3):
            value = 0.0
            for i in range(3):
                row[3 + i] = lower[i, k] if i >= k else 0.0
                value += row[3 + i] * (velocities[r, j, i] - state[3 + i])
            update_row(sized, state, cov, row, value, cauchy, gain)


@njit(cache=True, error_model="numpy")
def update_row(sized, state, covariance, row, innovation, cauchy, gain):
    """Update `state` and `covariance` of one joint with a scalar measurement of unit noise (Cauchy weight).

    Args:
        row: (S,) row of the measurement matrix, or shorter if all further elements are 0.
        innovation: Measured minus predicted value.
        gain: (S,), scratch.
    """
    size, spread = len(sized), 0.0
    for i in range(size):
        gain[i] = 0.0
        for k in range(len(row)):
            gain[i] += covariance[i, k] * row[k]
    for k in range(len(row)):
        spread += row[k] * gain[k]
    spread += relative_growth(innovation**2 / (spread + 1.0), cauchy)
    scaled = innovation / spread
    for i in range(size):
        state[i] += gain[i] * scaled
        for k in range(i + 1):
            covariance[i, k] -= gain[i] * gain[k] / spread
            covariance[k, i] = covariance[i, k]


@njit(cache=True, error_model="numpy")
def smoother_gains(sized, motion, transition, ahead, gains):
    """Write the transposed smoother gains (P, J, S, S), P_ahead^-1 F P, of a transition to `gains`."""
    lower = np.empty((len(sized), len(sized)))
    for p, j in np.ndindex(gains.shape[:2]):
        carried(sized, transition.forward, motion.covariances[p, j], gains[p, j])
        solve(sized, ahead.covariances[p, j], gains[p, j], lower)


@njit(cache=True, error_model="numpy")
def smooth(sized, motion, gains, predicted, measured, later, again):
    """Smooth one step backwards: `later` changes from the next instant to this instant.

    Args:
        motion: Filtered motion of this instant.
        gains: (P, J, S, S), transposed.
        predicted: Motion of the next instant, predicted from this instant.
        measured: (P, J) whether a joint is measured at the next instant.
        later: Smoothed motion of the next instant; becomes the smoothed motion of this instant.
        again: (P, J) whether a joint is measured after the next instant, without an interruption; becomes the
            same for this instant.
    """
    size = len(sized)
    half, change, difference = np.empty(size), np.empty(size), np.empty((size, size))
    for p, j in np.ndindex(again.shape):
        state, cov, gain = motion.states[p, j], motion.covariances[p, j], gains[p, j]
        ahead, ahead_cov = predicted.states[p, j], predicted.covariances[p, j]
        out, out_cov = later.states[p, j], later.covariances[p, j]
        again[p, j] = (again[p, j] or measured[p, j]) and np.isfinite(ahead[0])
        known = np.isfinite(out[0] + state[0] + ahead[0])  # at both instants, without a restart in between
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
