"""Measurements that depend on the motion, for views with stamps of their own.

See `domain.TimeShift`: a position is measured as X + G V (X + G (V - u) with the assumed G u given back),
and the views say the velocity by themselves with some information.
"""
from __future__ import annotations

import numpy as np

from panoptic_ros.geometry.robust import relative_growth
from panoptic_ros.kernels import njit
from panoptic_ros.refinement.kalman import update_row
from panoptic_ros.refinement.records import Motion
from panoptic_ros.refinement.small_matrices import cholesky, whiten, whitened_row

Array = np.ndarray


def started(points: Array, noises: Array, delays: Array, velocities: Array, spreads: Array) -> Motion:
    """Motion (J, 6) and (J, 6, 6) of J joints of which nothing else is known, from X + G V = points (J, 3).

    The velocities (J, 3) m/s have covariances `spreads` (J or 1, 3, 3), independent of the points' noises.
    """
    turned = delays @ spreads
    states, covariances = np.empty((len(points), 6)), np.empty((len(points), 6, 6))
    states[:, :3], states[:, 3:] = points - (delays @ velocities[..., None])[..., 0], velocities
    covariances[:, :3, :3] = noises + turned @ np.swapaxes(delays, 1, 2)
    covariances[:, :3, 3:], covariances[:, 3:, :3] = -turned, -np.swapaxes(turned, 1, 2)
    covariances[:, 3:, 3:] = spreads
    return Motion(states, covariances)


@njit(cache=True, error_model="numpy")
def update_moving(motion, rows, points, noises, delays, cauchy, innovations):
    """Update with X + G V = points (R, J, 3), in place, for delays G (R, J, 3, 3) s.

    All else is as in `kalman.update`, which this is for delays of 0.
    """
    size = motion.states.shape[2]
    row, ahead, gain = np.zeros(size), np.empty((3, size)), np.empty(size)
    total, lower, innovation = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    softness = 1.0 / (cauchy * cauchy)
    for r, j in np.ndindex(points.shape[:2]):
        state, cov = motion.states[rows[r], j], motion.covariances[rows[r], j]
        noise, whitened, delay = noises[rows[r], j], innovations[rows[r], j], delays[r, j]
        if not np.isfinite(points[r, j, 0] + state[0]):
            continue
        for i in range(3):
            innovation[i] = points[r, j, i] - state[i]
            for k in range(size):
                ahead[i, k] = cov[i, k]
                for m in range(3):
                    ahead[i, k] += delay[i, m] * cov[3 + m, k]
        for i in range(3):
            for k in range(3):
                innovation[i] -= delay[i, k] * state[3 + k]
                total[i, k] = noise[i, k] + ahead[i, k]
                for m in range(3):
                    total[i, k] += ahead[i, 3 + m] * delay[k, m]
        cholesky(total, lower, False)
        whiten(lower, innovation, whitened)
        squared = 0.0
        for i in range(3):
            squared += whitened[i] ** 2
        growth = relative_growth(squared / 3.0, softness)
        for i in range(3):
            for k in range(3):
                total[i, k] = noise[i, k] * growth
        cholesky(total, lower, False)
        for k in range(3):
            whitened_row(lower, k, row[:3])
            row[3:6] = 0.0
            value = 0.0
            for i in range(3):
                value += row[i] * points[r, j, i]
                for m in range(3):
                    row[3 + m] += row[i] * delay[i, m]
            for i in range(6):
                value -= row[i] * state[i]
            update_row(state, cov, row, value, np.inf, gain)


@njit(cache=True, error_model="numpy")
def update_velocities(motion, rows, velocities, information, cauchy):
    """Update with velocities (R, J, 3) m/s of inverse covariances (R, J, 3, 3), maybe singular, in place.

    Unknown joints and information of 0 change nothing.
    """
    size = motion.states.shape[2]
    row, gain, lower = np.zeros(size), np.empty(size), np.empty((3, 3))
    for r, j in np.ndindex(velocities.shape[:2]):
        state, cov = motion.states[rows[r], j], motion.covariances[rows[r], j]
        scale = information[r, j, 0, 0] + information[r, j, 1, 1] + information[r, j, 2, 2]
        if not (np.isfinite(state[0]) and scale > 0.0):
            continue
        cholesky(information[r, j], lower, False)
        for k in range(3):
            value = 0.0
            for i in range(3):
                row[i], row[3 + i] = 0.0, lower[i, k] if i >= k else 0.0
                value += row[3 + i] * velocities[r, j, i]
            for i in range(3, 6):
                value -= row[i] * state[i]
            update_row(state, cov, row, value, cauchy, gain)
