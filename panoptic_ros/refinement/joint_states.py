"""States of joints after smoothing: measured, filled, predicted or missing."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import JointState
from panoptic_ros.kernels import njit

Array = np.ndarray

MISSING, MEASURED, PREDICTED, FILLED = (int(state) for state in JointState)


class SmoothedJoints(NamedTuple):
    """Joints of all people with their states."""

    positions: Array  # (P, J, 3) m
    covariances: Array  # (P, J, 3, 3) m^2
    scores: Array  # (P, J)
    states: Array  # (P, J) `JointState`


@njit(cache=True, error_model="numpy")
def take_measurements(measured, rows, points, covariances, scores, views):
    """Store points (R, J, 3) m in `measured`, as the latest measurements of the people in these rows.

    Args:
        measured: `JointMeasurements` of the moment, updated.
        rows: (R,) rows of the people.
        points: (R, J, 3) m, NaN = not measured.
        covariances: (R, J, 3, 3) m^2.
        scores, views: (R, J).
    """
    for r in range(len(rows)):
        p = rows[r]
        measured.people[p] = True
        for j in range(points.shape[1]):
            if not np.isfinite(points[r, j, 0]):
                continue
            measured.joints[p, j], measured.ages[p, j], measured.carried[p, j] = True, 0.0, True
            measured.views[p, j], measured.scores[p, j] = views[r, j], scores[r, j]
            for i in range(3):
                for k in range(3):
                    measured.noises[p, j, i, k] = covariances[r, j, i, k]


@njit(cache=True, error_model="numpy")
def judge(motion, measured, again, scales, lasting, limits, judged):
    """Write the smoothed joints and their states to `judged`.

    Joints in gaps that are too long or too uncertain are missing.

    Args:
        motion: Smoothed motion.
        measured: `JointMeasurements` of the moment.
        again: (P, J) whether a joint is measured again later, without an interruption.
        scales: (P,) factors on the covariances.
        lasting: (P, J) share of the noise that smoothing does not remove; here it adds to the
            uncertainty, but the resulting covariances do not contain it.
        limits: (m, s) largest standard deviation of joints that are not measured, and largest age of
            predictions.
        judged: `SmoothedJoints`, output.
    """
    for p, j in np.ndindex(again.shape):
        state, cov = motion.states[p, j], motion.covariances[p, j]
        trace = 0.0
        for i in range(3):
            trace += scales[p] * cov[i, i] + lasting[p, j] * measured.noises[p, j, i, i]
        kind, score = MISSING, 0.5 * measured.scores[p, j]
        if measured.joints[p, j]:
            kind, score = MEASURED, measured.scores[p, j]
        elif np.isfinite(state[0]) and np.sqrt(trace / 3.0) < limits[0]:
            if again[p, j]:
                kind = FILLED
            elif measured.people[p] and (measured.ages[p, j] <= limits[1] or measured.carried[p, j]):
                kind = PREDICTED
        there = kind != MISSING
        judged.states[p, j], judged.scores[p, j] = kind, score if there else 0.0
        for i in range(3):
            judged.positions[p, j, i] = state[i] if there else np.nan
            for k in range(3):
                judged.covariances[p, j, i, k] = scales[p] * cov[i, k] if there else np.nan
