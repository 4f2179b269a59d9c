"""Prediction and update of the guidance's filter for all joints of all people, compiled.

`geometry.motion` is the numpy reference of the filter.
"""
from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit


@njit(cache=True, error_model="numpy")
def predict_people(states, variances, ages, unseen, unagreed, balance, dt, fade, growth, lost,
                   memory):  # fmt: skip
    """Prediction step: all tables dt s later, without the people who are forgotten.

    Args:
        states (T, J, 6), variances (T, J, 3), ages (T, J), unseen (T,), unagreed (T, J), balance (T, G): see
            `Guidance`.
        fade: factor on the velocity of joints that were not measured last. growth: what white acceleration
            adds to the three variances. lost: m^2, variance from which a joint is forgotten.
        memory: s, after which unseen people are.
    """
    people, joints = ages.shape
    kept = np.empty(people, np.int64)
    count = 0
    for t in range(people):
        alive = False
        for j in range(joints):
            alive |= np.isfinite(states[t, j, 0]) and not moved_variance(variances[t, j], dt, growth) > lost
        if alive and unseen[t] + dt <= memory:
            kept[count] = t
            count += 1
    kept = kept[:count]
    states, variances, balance = states[kept], variances[kept], balance[kept]
    ages, unseen, unagreed = ages[kept], unseen[kept] + dt, unagreed[kept] + dt
    for t in range(count):
        for j in range(joints):
            factor = fade if ages[t, j] > 0.0 else 1.0
            ages[t, j] += dt
            state, variance = states[t, j], variances[t, j]
            for k in range(3):
                state[3 + k] *= factor
                state[k] += dt * state[3 + k]
            variance[0] = moved_variance(variance, dt, growth)
            variance[1] = variance[1] + dt * variance[2] + growth[1]
            variance[2] = variance[2] + growth[2]
            if variance[0] > lost:
                for k in range(6):
                    state[k] = np.nan
    return states, variances, ages, unseen, unagreed, balance


@njit(cache=True, error_model="numpy")
def moved_variance(variance, dt, growth):
    """Variance of a position dt s later, m^2."""
    return variance[0] + 2.0 * dt * variance[1] + dt * dt * variance[2] + growth[0]


@njit(cache=True, error_model="numpy")
def update_people(states, variances, ages, unseen, unagreed, balance, who, positions, covariances, exchanged,
                  firm, start_speed, balance_memory):  # fmt: skip
    """Update step: take the skeletons of an instant into the tables, in place; new people have the last rows.

    Args:
        who: (P,) row of the tables, -1 = new. positions (P, J, 3) m, covariances (P, J, 3, 3) m^2.
        exchanged: (P, G), see `Guidance.update`. firm: (P, J) whether enough views agree on a joint.
        start_speed: m/s, standard deviation of a new joint's velocity.
        balance_memory: share of the balance that is kept.
    """
    joints, newest = ages.shape[1], len(ages)
    for p in range(len(who)):
        newest -= who[p] < 0
    for p in range(len(who)):
        t = who[p]
        if t < 0:
            t = newest
            newest += 1
        unseen[t] = 0.0
        for g in range(balance.shape[1]):
            balance[t, g] = balance_memory * balance[t, g] + exchanged[p, g]
        for j in range(joints):
            if firm[p, j]:
                unagreed[t, j] = 0.0
            if np.isfinite(positions[p, j, 0]):
                ages[t, j] = 0.0
                c = covariances[p, j]
                noise = (c[0, 0] + c[1, 1] + c[2, 2]) / 3.0
                _update_joint(states[t, j], variances[t, j], positions[p, j], noise, start_speed)


@njit(cache=True, error_model="numpy")
def _update_joint(state, variance, point, noise, start_speed):
    """Update one joint with a measurement, in place; see `geometry.motion.update_motion`."""
    if not np.isfinite(state[0]):
        for k in range(3):
            state[k], state[3 + k] = point[k], 0.0
        variance[0], variance[1], variance[2] = noise, 0.0, start_speed**2
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
