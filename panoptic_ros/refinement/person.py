"""The motion of one person: filter, smoother, gaps."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain import JointState
from panoptic_ros.refinement.config import RefinementConfig
from panoptic_ros.refinement.kalman import (
    predict_states,
    raise_speeds,
    smooth_states,
    update_states,
)

Array = np.ndarray

SPEED_MEMORY = 0.3  # s, how long a joint that was fast is expected to be so
TOP_SPEED = 3.0  # m/s against the body; more is noise


@dataclass(slots=True, eq=False)
class Moment:
    """One person at one instant: J joints.

    Args:
        dt: s since the moment before. predicted (J, 6), predicted_covariances (J, 6, 6): from the
            moment before. states, covariances: with this instant's measurement. NaN = unknown.
        measured: (J,) bool. scores (J,), views (J,): of the measurement. person_score.
        ages: (J,) s since each joint was measured. seen: the person is in this set.
    """

    stamp_ns: int
    dt: float
    predicted: Array
    predicted_covariances: Array
    states: Array
    covariances: Array
    measured: Array
    scores: Array
    views: Array
    ages: Array
    person_score: float
    seen: bool


@dataclass(frozen=True, slots=True, eq=False)
class Smoothed:
    """One person, refined: positions (J, 3), covariances (J, 3, 3), scores, views, states (J,)."""

    positions: Array
    covariances: Array
    scores: Array
    views: Array
    states: Array
    person_score: float


class PersonMotion:
    """Filter and recent moments of one person."""

    def __init__(self, config: RefinementConfig, joints: int):
        self._config, self._joints = config, joints
        self._moments: list[Moment] = []
        self._speeds = np.zeros(joints)  # m/s, largest lately against the body

    def begin(self, stamp_ns: int) -> None:
        """Move on to an instant; `measure` may follow."""
        if self._moments:
            last = self._moments[-1]
            dt = 1e-9 * (stamp_ns - last.stamp_ns)
            noise = self._process_noise(last, dt)
            states, covariances = predict_states(last.states, last.covariances, dt, noise)
            ages, scores, person_score = last.ages + dt, last.scores, last.person_score
            states[ages > self._config.max_gap] = np.nan
        else:
            dt, states = 0.0, np.full((self._joints, 6), np.nan)
            covariances, ages = np.zeros((self._joints, 6, 6)), np.zeros(self._joints)
            scores, person_score = np.zeros(self._joints), 0.0
        nothing = np.zeros(self._joints)
        self._moments.append(
            Moment(stamp_ns, dt, states, covariances, states.copy(), covariances.copy(), nothing > 0.0,
                   scores.copy(), nothing.astype(int), ages, person_score, False)
        )  # fmt: skip

    def _process_noise(self, last: Moment, dt: float) -> Array:
        """Spectral density (J,) of acceleration: limbs that swing need more than the trunk."""
        self._speeds *= np.exp(-dt / SPEED_MEMORY)
        raise_speeds(self._speeds, last.states, TOP_SPEED)
        return self._config.process_noise + self._config.limb_noise * self._speeds**2

    def measure(
        self, positions: Array, covariances: Array, scores: Array, views: Array, person_score: float
    ) -> None:
        """Take the measurement of the instant that was begun."""
        now = self._moments[-1]
        measured = np.isfinite(positions[:, 0])
        relief = 1.0 + self._config.few_views_relief / np.maximum(views - 1.0, 1.0)
        covariances = covariances / relief[:, None, None]
        fresh = measured & ~np.isfinite(now.states[:, 0])
        now.states[fresh, :3], now.states[fresh, 3:] = positions[fresh], 0.0
        now.covariances[fresh] = 0.0
        now.covariances[fresh, :3, :3] = covariances[fresh]
        now.covariances[fresh, 3:, 3:] = self._config.start_speed**2 * np.eye(3)
        known = np.where((measured & ~fresh)[:, None], positions, np.nan)
        update_states(now.states, now.covariances, known, covariances, self._config.cauchy)
        now.measured, now.seen, now.person_score = measured, True, person_score
        now.scores = np.where(measured, scores, now.scores)
        now.views = np.where(measured, views, 0)
        now.ages = np.where(measured, 0.0, now.ages)

    def seen_after(self, stamp_ns: int) -> bool:
        """Whether the person was seen in a kept instant that is still to come after this one."""
        return any(moment.seen and moment.stamp_ns > stamp_ns for moment in self._moments)

    def forget_before(self, stamp_ns: int) -> None:
        """Drop moments that are not needed to smooth from `stamp_ns` on."""
        while len(self._moments) > 1 and self._moments[1].stamp_ns <= stamp_ns:
            self._moments.pop(0)

    @property
    def unseen(self) -> float:
        """Seconds since any joint was measured."""
        return float(self._moments[-1].ages.min()) if self._moments else np.inf

    def smoothed(self, stamp_ns: int) -> Smoothed | None:
        """The person at a kept instant, with all that came after; None if it was not there."""
        index = next((i for i, m in enumerate(self._moments) if m.stamp_ns == stamp_ns), None)
        if index is None:
            return None
        target = self._moments[index]
        later = self._moments[index + 1 :]
        if not target.seen and not any(moment.seen for moment in later):
            return None
        states, covariances = self._moments[-1].states, self._moments[-1].covariances
        again = np.zeros(self._joints, bool)  # measured later, without an interruption
        for i in range(len(self._moments) - 2, index - 1, -1):
            now, after = self._moments[i], self._moments[i + 1]
            again = (again | after.measured) & np.isfinite(after.predicted[:, 0])
            states, covariances = smooth_states(
                now.states, now.covariances, after.dt, after.predicted, after.predicted_covariances,
                states, covariances,
            )  # fmt: skip
        return self._judged(target, states, covariances, again)

    def _judged(self, target: Moment, states: Array, covariances: Array, again: Array) -> Smoothed:
        """Positions with their states; gaps that are too long or too uncertain are missing."""
        config = self._config
        spread = covariances[:, :3, :3]
        sigma = np.sqrt(np.trace(spread, axis1=1, axis2=2) / 3.0)
        known = np.isfinite(states[:, 0])
        bridged = known & ~target.measured & (sigma < config.max_sigma)
        filled = bridged & again
        predicted = bridged & ~again & target.seen & (target.ages <= config.max_prediction)
        kind = np.full(self._joints, JointState.MISSING, np.uint8)
        kind[target.measured] = JointState.MEASURED
        kind[filled] = JointState.FILLED
        kind[predicted] = JointState.PREDICTED
        there = kind != JointState.MISSING
        scores = np.where(target.measured, target.scores, 0.5 * target.scores)
        return Smoothed(
            np.where(there[:, None], states[:, :3], np.nan),
            np.where(there[:, None, None], spread, np.nan),
            np.where(there, scores, 0.0), target.views, kind, target.person_score,
        )  # fmt: skip
