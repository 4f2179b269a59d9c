"""The motion of one person: filter, smoother, gaps."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain import JointState, TimeShift
from panoptic_ros.refinement.config import RefinementConfig
from panoptic_ros.refinement.kalman import (
    predict_states,
    raise_speeds,
    smooth_states,
    update_states,
)
from panoptic_ros.refinement.motion_rows import start_moving, update_moving, update_velocities
from panoptic_ros.refinement.start_motion import likely_velocities
from panoptic_ros.refinement.tuning import LastingErrors, Tuning

Array = np.ndarray

MISSING, MEASURED, PREDICTED, FILLED = (int(state) for state in JointState)  # quicker than the enum
SPEED_MEMORY = 0.3  # s, how long a joint that was fast is expected to be so
TOP_SPEED = 3.0  # m/s against the body; more is noise


@dataclass(slots=True, eq=False)
class Moment:
    """One person at one instant: J joints.

    Args:
        dt: s since the moment before. noise: (J,) m^2/s^3, process noise since then.
        predicted (J, 6), predicted_covariances (J, 6, 6): from the moment before.
        states, covariances: with this instant's measurement. NaN = unknown.
        measured: (J,) bool. scores (J,), views (J,): of the measurement. person_score.
        ages: (J,) s since each joint was measured. seen: the person is in this set.
        noises: (J, 3, 3) m^2, of the latest measurement of each joint, 0 before any.
    """

    stamp_ns: int
    dt: float
    noise: Array
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
    noises: Array


@dataclass(frozen=True, slots=True, eq=False)
class Smoothed:
    """One person, refined: positions (J, 3), covariances (J, 3, 3), scores, views, states (J,).

    lasting: (J, 3, 3) m^2, what errors that last add to the covariances; it is no noise to smooth with.
    """

    positions: Array
    covariances: Array
    scores: Array
    views: Array
    states: Array
    person_score: float
    lasting: Array


class PersonMotion:
    """Filter and recent moments of one person."""

    def __init__(self, config: RefinementConfig, joints: int, lasting: LastingErrors, share: float):
        """share: of the variance of measurements, of errors that last."""
        self._config, self._joints, self._share = config, joints, share
        self._moments: list[Moment] = []
        self._tuning = Tuning(joints, lasting)
        self._still = np.zeros((joints, 3, 3))
        self._speeds = np.zeros(joints)  # m/s relative to the body, the largest of late

    def predict(self, stamp_ns: int) -> None:
        """Predict the motion to an instant; `update` may follow."""
        if self._moments:
            last = self._moments[-1]
            dt = 1e-9 * (stamp_ns - last.stamp_ns)
            noise = self._process_noise(last, dt)
            states, covariances = predict_states(last.states, last.covariances, dt, noise)
            ages, scores, person_score = last.ages + dt, last.scores, last.person_score
            noises = last.noises
            states[ages > self._config.max_gap] = np.nan
        else:
            dt, states = 0.0, np.full((self._joints, 6), np.nan)
            noise = np.full(self._joints, self._config.process_noise)
            covariances, ages = np.zeros((self._joints, 6, 6)), np.zeros(self._joints)
            scores, person_score, noises = np.zeros(self._joints), 0.0, self._still
        nothing = np.zeros(self._joints)
        self._moments.append(
            Moment(stamp_ns, dt, noise, states, covariances, states.copy(), covariances.copy(), nothing > 0.0,
                   scores.copy(), nothing.astype(int), ages, person_score, False, noises)
        )  # fmt: skip

    def _process_noise(self, last: Moment, dt: float) -> Array:
        """Spectral density (J,) of acceleration: limbs that swing need more than the trunk."""
        self._speeds *= np.exp(-dt / SPEED_MEMORY)
        raise_speeds(self._speeds, last.states, TOP_SPEED)
        own = self._config.process_noise + self._config.limb_noise * self._speeds**2
        return self._tuning.factor * own

    def update(
        self, positions: Array, covariances: Array, scores: Array, views: Array, person_score: float,
        shift: TimeShift | None = None,
    ) -> None:  # fmt: skip
        """Update with the measurement of the predicted instant; shift: of this person alone."""
        now, config = self._moments[-1], self._config
        measured = np.isfinite(positions[:, 0])
        relief = 1.0 + config.few_views_relief / np.maximum(views - 1.0, 1.0)
        covariances = covariances / relief[:, None, None]
        delays, points = self._still, positions
        if shift is not None:
            delays, assumed = shift.delays[0].copy(), shift.assumed[0]  # writable, as `_still`: one kernel
            points = positions + (delays @ assumed[..., None])[..., 0]
        known = np.isfinite(now.states[:, 0])
        if (measured & ~known).any():
            velocities, spreads = self._start(shift)
            start_moving(now.states, now.covariances, points, covariances, delays, velocities, spreads)
        points = np.where(known[:, None], points, np.nan)
        innovations = np.full((self._joints, 3), np.nan)
        if shift is None:
            update_states(now.states, now.covariances, points, covariances, config.cauchy, innovations)
        else:
            update_moving(
                now.states, now.covariances, points, covariances, delays, config.cauchy, innovations
            )
            information = np.where(known[:, None, None], shift.information[0], 0.0)  # new ones have used it
            update_velocities(now.states, now.covariances, shift.velocities[0], information, config.cauchy)
        self._tuning.learn(innovations)
        now.measured, now.seen, now.person_score = measured, True, person_score
        now.scores = np.where(measured, scores, now.scores)
        now.views = np.where(measured, views, 0)
        now.ages = np.where(measured, 0.0, now.ages)
        now.noises = np.where(measured[:, None, None], covariances, now.noises)

    def _start(self, shift: TimeShift | None) -> tuple[Array, Array]:
        """Velocities (J, 3) of joints that are new, and their covariances (J, 3, 3)."""
        fast = self._config.start_speed
        if shift is None:
            return np.zeros((self._joints, 3)), np.tile(fast**2 * np.eye(3), (self._joints, 1, 1))
        return likely_velocities(shift.velocities[0], shift.information[0], fast, self._config.cauchy)

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

    def smoothed(self, stamp_ns: int, instant_ns: int) -> Smoothed | None:
        """The person of the set of a kept stamp, with all that came after; None if it was not there.

        Args:
            instant_ns: for which it is wanted, not before the set and before the next one.
        """
        index = next((i for i, m in enumerate(self._moments) if m.stamp_ns == stamp_ns), None)
        if index is None:
            return None
        target = self._moments[index]
        later = self._moments[index + 1 :]
        if not target.seen and not any(moment.seen for moment in later):
            return None
        states, covariances = self._moments[-1].states, self._moments[-1].covariances
        again = np.zeros(self._joints, bool)  # measured later, without an interruption
        ahead = 1e-9 * (instant_ns - stamp_ns)
        for i in range(len(self._moments) - 2, index - 1, -1):
            now, after = self._moments[i], self._moments[i + 1]
            again = (again | after.measured) & np.isfinite(after.predicted[:, 0])
            before, spread, dt = now.states, now.covariances, after.dt
            if i == index and ahead > 0.0:
                before, spread = predict_states(before, spread, ahead, after.noise)
                dt -= ahead
            states, covariances = smooth_states(
                before, spread, dt, after.predicted, after.predicted_covariances, states, covariances
            )
        if ahead > 0.0 and not later:
            states, covariances = predict_states(states, covariances, ahead, target.noise)
        return self._judged(target, states, covariances, again)

    def _judged(self, target: Moment, states: Array, covariances: Array, again: Array) -> Smoothed:
        """Positions with their states; gaps that are too long or too uncertain are missing."""
        config = self._config
        spread = self._tuning.scale * covariances[:, :3, :3]
        lasting = self._lasting_part(target)
        sigma = np.sqrt(np.trace(spread + lasting, axis1=1, axis2=2) / 3.0)
        known = np.isfinite(states[:, 0])
        bridged = known & ~target.measured & (sigma < config.max_sigma)
        filled = bridged & again
        predicted = bridged & ~again & target.seen & (target.ages <= config.max_prediction)
        kind = np.full(self._joints, MISSING, np.uint8)
        kind[target.measured] = MEASURED
        kind[filled] = FILLED
        kind[predicted] = PREDICTED
        there = kind != MISSING
        scores = np.where(target.measured, target.scores, 0.5 * target.scores)
        return Smoothed(
            np.where(there[:, None], states[:, :3], np.nan),
            np.where(there[:, None, None], spread, np.nan),
            np.where(there, scores, 0.0), target.views, kind, target.person_score, lasting,
        )  # fmt: skip

    def _lasting_part(self, target: Moment) -> Array:
        """Covariances (J, 3, 3) m^2 of errors that last.

        A joint that is not measured now was lost to what made it err before: nothing is taken off.
        """
        share = np.where(target.measured, self._share, float(self._share > 0.0))
        lasting: Array = share[:, None, None] * target.noises
        return lasting
