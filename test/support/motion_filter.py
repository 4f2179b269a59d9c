"""Constant-velocity Kalman filters for many points at once, one variance for all three axes.

A cheap filter for prediction and gating; state (..., 6) position m and velocity m/s, variances
(..., 3): of position, covariance of position and velocity, of velocity (per axis).
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def predict_motion(states: Array, variances: Array, dt: float, density: float) -> tuple[Array, Array]:
    """States and variances dt s later, under white acceleration of that spectral density, m^2/s^3.

    NaN states stay NaN.
    """
    moved = states.copy()
    moved[..., :3] += dt * states[..., 3:]
    pp, pv, vv = variances[..., 0], variances[..., 1], variances[..., 2]
    grown = np.stack(
        [
            pp + 2.0 * dt * pv + dt * dt * vv + density * dt**3 / 3.0,
            pv + dt * vv + density * dt**2 / 2.0,
            vv + density * dt,
        ],
        axis=-1,
    )
    return moved, grown


def update_motion(
    states: Array, variances: Array, points: Array, noise: Array, start_speed: float
) -> tuple[Array, Array]:
    """States and variances after measuring points (..., 3) m with variances noise (...) m^2 per axis.

    NaN points change nothing. Where the state is NaN and the point is not, the state starts there at
    rest, with start_speed m/s as standard deviation of its velocity.
    """
    measured, known = np.isfinite(points[..., 0]), np.isfinite(states[..., 0])
    spread = np.maximum(variances[..., 0] + noise, 1e-12)
    gain_x, gain_v = variances[..., 0] / spread, variances[..., 1] / spread
    innovation = points - states[..., :3]
    moved = np.concatenate(
        [
            states[..., :3] + gain_x[..., None] * innovation,
            states[..., 3:] + gain_v[..., None] * innovation,
        ],
        axis=-1,
    )
    shrunk = np.stack(
        [
            (1.0 - gain_x) * variances[..., 0],
            (1.0 - gain_x) * variances[..., 1],
            variances[..., 2] - gain_v * variances[..., 1],
        ],
        axis=-1,
    )
    born = np.concatenate([points, np.zeros_like(points)], axis=-1)
    rest = np.zeros_like(noise)
    born_variances = np.stack([noise, rest, np.full_like(noise, start_speed**2)], axis=-1)
    both, first = (measured & known)[..., None], (measured & ~known)[..., None]
    new_states = np.where(both, moved, np.where(first, born, states))
    return new_states, np.where(both, shrunk, np.where(first, born_variances, variances))
