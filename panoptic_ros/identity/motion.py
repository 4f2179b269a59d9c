"""Constant-velocity filter for all joints of the tracked people; compiled.

Its predictions are only used for choices: association, starting points, sides, time shifts, identity. The
positions of measured joints come from the present images.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import JointState, Prediction, TrackSet
from panoptic_ros.kernels import njit

Array = np.ndarray

ACCELERATION = 10.0**2 / 25.0  # m^2/s^3, spectral density of a joint's acceleration: 10 m/s^2 for 1/25 s
START_SPEED = 1.5  # m/s, standard deviation of the velocity of a new joint
FADE_TIME = 0.15  # s, time constant with which the velocity of an unmeasured joint decays
LOST_SIGMA = 0.35  # m, standard deviation per axis beyond which a predicted joint is dropped
FILLED = int(JointState.FILLED)
FIRM_VIEWS = 3  # views that must agree on a joint for its position to be firm
FIRM_TIME = 0.08  # s, time for which the position stays firm


class JointMotion(NamedTuple):
    """Filters of T people's J joints.

    Args:
        states: (T, J, 6) position m and velocity m/s, world, NaN = unknown.
        variances: (T, J, 3) per axis: position variance m^2, position-velocity covariance m^2/s, velocity
            variance m^2/s^2.
        ages: (T, J) s since the joint was measured.
        unagreed: (T, J) s since FIRM_VIEWS views agreed on the joint, infinite if never.
    """

    states: Array
    variances: Array
    ages: Array
    unagreed: Array

    @classmethod
    def of_new(cls, people: int, joints: int) -> JointMotion:
        """Return the filters of people before their first measurement."""
        return cls(
            np.full((people, joints, 6), np.nan),
            np.zeros((people, joints, 3)),
            np.zeros((people, joints)),
            np.full((people, joints), np.inf),
        )


def predicted(tracks: TrackSet, stamp_ns: int, memory: float) -> Prediction:
    """Return the prediction for an instant, for tracks that were seen within the last `memory` s."""
    dt = 1e-9 * max(stamp_ns - tracks.stamp_ns, 0)
    motion = JointMotion(
        tracks.states.copy(), tracks.variances.copy(), tracks.ages.copy(), tracks.unagreed.copy()
    )
    predict(motion, dt)
    known = np.isfinite(motion.states[..., 0])
    rows = np.flatnonzero(known.any(axis=1) & (tracks.unseen + dt <= memory))
    states = motion.states[rows]
    return Prediction(
        states[..., :3].copy(),
        np.where(known[rows][..., None], states[..., 3:], 0.0),
        motion.ages[rows],
        motion.variances[rows],
        motion.unagreed[rows] <= FIRM_TIME,
        tracks.lengths[rows],
    )


@njit(cache=True, error_model="numpy")
def predict(motion, dt):
    """Predict the filters by dt >= 0 s, in place.

    The velocity of a joint decays unless the joint was measured at the last step. Acceleration is white
    noise, so variances depend on the elapsed time and not on the number of steps. A joint less certain than
    LOST_SIGMA becomes unknown.
    """
    fade = np.exp(-dt / FADE_TIME)
    growth = (ACCELERATION * dt**3 / 3.0, ACCELERATION * dt**2 / 2.0, ACCELERATION * dt)
    states, variances, ages, unagreed = motion
    for t in range(ages.shape[0]):
        for j in range(ages.shape[1]):
            factor = fade if ages[t, j] > 0.0 else 1.0
            ages[t, j] += dt
            unagreed[t, j] += dt
            state, variance = states[t, j], variances[t, j]
            for k in range(3):
                state[3 + k] *= factor
                state[k] += dt * state[3 + k]
            variance[0] = variance[0] + 2.0 * dt * variance[1] + dt * dt * variance[2] + growth[0]
            variance[1] = variance[1] + dt * variance[2] + growth[1]
            variance[2] = variance[2] + growth[2]
            if variance[0] > LOST_SIGMA**2:
                for k in range(6):
                    state[k] = np.nan


@njit(cache=True, error_model="numpy")
def update_joints(motion, t, positions, covariances, views, states):
    """Update the filters of person t with a skeleton, in place.

    A joint that was filled with the help of the prediction and bones is not an independent measurement. It
    replaces the position of its filter.

    Args:
        positions: (J, 3) m, NaN = missing.
        covariances: (J, 3, 3) m^2.
        views: (J,) number of inlier views.
        states: (J,) of `JointState`.
    """
    for j in range(len(positions)):
        if views[j] >= FIRM_VIEWS:
            motion.unagreed[t, j] = 0.0
        if states[j] == FILLED and np.isfinite(motion.states[t, j, 0]):
            motion.ages[t, j] = 0.0
            _replace_joint(motion.states[t, j], motion.variances[t, j], positions[j], covariances[j])
            continue
        if np.isfinite(positions[j, 0]):
            motion.ages[t, j] = 0.0
            c = covariances[j]
            noise = (c[0, 0] + c[1, 1] + c[2, 2]) / 3.0
            _update_joint(motion.states[t, j], motion.variances[t, j], positions[j], noise)


@njit(cache=True, error_model="numpy")
def _replace_joint(state, variance, point, covariance):
    """Set one joint to a position that was estimated with the help of its prediction, in place.

    The filter has one variance for all axes. It takes the variance of the least certain axis, along which no
    view measures.
    """
    worst = 0.0
    for k in range(3):
        for m in range(3):
            worst += covariance[k, m] ** 2
    share = min(1.0, np.sqrt(worst) / max(variance[0], 1e-12))  # Frobenius norm >= largest eigenvalue
    slope = variance[1] / max(variance[0], 1e-12)
    for k in range(3):
        state[3 + k] += slope * (point[k] - state[k])
        state[k] = point[k]
    variance[2] -= slope * variance[1] * (1.0 - share)
    variance[0] *= share
    variance[1] *= share


@njit(cache=True, error_model="numpy")
def _update_joint(state, variance, point, noise):
    """Update one joint with a measurement, in place: a Kalman filter with one variance for all axes.

    Args:
        state: (6,) m and m/s.
        variance: (3,) see `JointMotion`.
        point: (3,) m, measured position.
        noise: m^2, variance of the measurement per axis.
    """
    if not np.isfinite(state[0]):
        for k in range(3):
            state[k], state[3 + k] = point[k], 0.0
        variance[0], variance[1], variance[2] = noise, 0.0, START_SPEED**2
        return
    spread = variance[0] + noise
    if spread < 1e-12:
        spread = 1e-12
    gain_x, gain_v = variance[0] / spread, variance[1] / spread
    for k in range(3):
        innovation = point[k] - state[k]
        state[k] += gain_x * innovation
        state[3 + k] += gain_v * innovation
    variance[2] -= gain_v * variance[1]
    variance[0] *= 1.0 - gain_x
    variance[1] *= 1.0 - gain_x
