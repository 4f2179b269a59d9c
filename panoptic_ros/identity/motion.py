"""The constant-velocity filter of all joints of everybody who is followed, compiled.

Predictions serve for choices only: association, starting points, sides, time shifts, identity. The positions
of skeletons are functions of the present images.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import JointState, Prediction, TrackSet
from panoptic_ros.kernels import njit

Array = np.ndarray

ACCELERATION = 10.0**2 / 25.0  # m^2/s^3, spectral density of a joint's acceleration: 10 m/s^2 over 1/25 s
START_SPEED = 1.5  # m/s, standard deviation of the velocity of a new joint
FADE_TIME = 0.15  # s, over which the predicted velocity of an unseen joint fades
LOST_SIGMA = 0.35  # m, joints whose prediction is less certain are forgotten
FILLED = int(JointState.FILLED)
FIRM_VIEWS = 3  # views that must agree on a joint to make its position firm
FIRM_TIME = 0.08  # s, how long it stays firm


class JointMotion(NamedTuple):
    """Filters of T people's J joints.

    states (T, J, 6) m and m/s, NaN = unknown; variances (T, J, 3) of position, of position with velocity, of
    velocity, per axis; ages (T, J) s since measured; unagreed (T, J) s since FIRM_VIEWS views agreed on the
    joint, infinite if never.
    """

    states: Array
    variances: Array
    ages: Array
    unagreed: Array

    @classmethod
    def of_new(cls, people: int, joints: int) -> JointMotion:
        """Filters of people before their first measurement."""
        return cls(
            np.full((people, joints, 6), np.nan),
            np.zeros((people, joints, 3)),
            np.zeros((people, joints)),
            np.full((people, joints), np.inf),
        )


def predicted(tracks: TrackSet, stamp_ns: int, memory: float) -> Prediction:
    """Where those should be at an instant who were seen within `memory` s before it."""
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
    """Predict in place to dt >= 0 s later: of joints that were not measured last the velocity fades.

    Acceleration is white noise, so variances grow by the time that passes and not by the number of steps.
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
    """Update person t in place with a skeleton: (J, 3) m, (J, 3, 3) m^2, number of inlier views, states (J,).

    Joints that are filled from the prediction and bones are what the filter comes to, not a measurement.
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
    """Set one joint to where it was found with the help of its prediction, in place.

    The filter has one variance for all axes: it takes that of the least certain one, which are those that no
    view shows.
    """
    worst = 0.0
    for k in range(3):
        for m in range(3):
            worst += covariance[k, m] ** 2
    share = min(1.0, np.sqrt(worst) / max(variance[0], 1e-12))  # the Frobenius norm bounds the largest one
    slope = variance[1] / max(variance[0], 1e-12)
    for k in range(3):
        state[3 + k] += slope * (point[k] - state[k])
        state[k] = point[k]
    variance[2] -= slope * variance[1] * (1.0 - share)
    variance[0] *= share
    variance[1] *= share


@njit(cache=True, error_model="numpy")
def _update_joint(state, variance, point, noise):
    """Update one joint with a measurement, in place: a Kalman filter with one variance for all axes."""
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
