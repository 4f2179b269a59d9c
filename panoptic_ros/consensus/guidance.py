"""The skeletons that assembly itself found last: where their joints should be now."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.geometry.motion import predict_motion, update_motion

Array = np.ndarray

START_SPEED = 1.5  # m/s, standard deviation of the velocity of a new joint
FADE_TIME = 0.15  # s, over which the predicted velocity of an unseen joint fades
LOST_SIGMA = 0.35  # m, joints predicted worse than this are forgotten
FIRM_VIEWS = 3  # that agree on a joint make its place firm
FIRM_TIME = 0.08  # s, for so long
BALANCE_MEMORY = 0.9  # per frame, of how many views see a limb with its sides exchanged


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """Where P people should be.

    positions: (P, J, 3) m, NaN = unknown. velocities: (P, J, 3) m/s, 0 where unknown.
    ages: (P, J) s since measured. variances: (P, J, 3), see `geometry.motion`.
    firm: (P, J) whether three or more views agreed on the joint a moment ago.
    """

    positions: Array
    velocities: Array
    ages: Array
    variances: Array
    firm: Array


class Guidance:
    """A constant-velocity filter per joint of each person.

    Serves choices only (which 2D person, which start, which side, which time shift): the positions
    that assembly gives are functions of the present images.
    """

    def __init__(self, mirror: Array, groups: Array, memory: float, acceleration: float):
        self._joints, self._mirror, self._groups = len(mirror), mirror, groups
        self._memory, self._acceleration = memory, acceleration
        self.clear()

    def clear(self) -> None:
        """Forget everybody."""
        self._states = np.empty((0, self._joints, 6))
        self._variances = np.empty((0, self._joints, 3))
        self._ages = np.empty((0, self._joints))
        self._unagreed = np.empty((0, self._joints))  # s since FIRM_VIEWS views agreed
        self._unseen = np.empty(0)  # s since the person was seen
        self._balance = np.empty((0, self._groups.max(initial=-1) + 1))  # exchanged minus straight views

    def predict(self, dt: float) -> Prediction:
        """Move on by dt >= 0 s, drop who was not seen for long, and say where all should be."""
        fade = np.where(self._ages > 0.0, np.exp(-dt / FADE_TIME), 1.0)
        self._states[..., 3:] *= fade[..., None]
        self._states, self._variances = predict_motion(
            self._states, self._variances, dt, self._acceleration
        )
        self._ages, self._unseen = self._ages + dt, self._unseen + dt
        self._unagreed = self._unagreed + dt
        self._states[self._variances[..., 0] > LOST_SIGMA**2] = np.nan
        known = np.isfinite(self._states[..., 0])
        alive = (self._unseen <= self._memory) & known.any(axis=1)
        self._states, self._variances = self._states[alive], self._variances[alive]
        self._ages, self._unseen = self._ages[alive], self._unseen[alive]
        self._balance, self._unagreed = self._balance[alive], self._unagreed[alive]
        velocities = np.where(known[alive][..., None], self._states[..., 3:], 0.0)
        return Prediction(
            self._states[..., :3].copy(), velocities, self._ages.copy(), self._variances.copy(),
            self._unagreed <= FIRM_TIME,
        )  # fmt: skip

    def update(
        self, who: Array, positions: Array, covariances: Array, exchanged: Array, views: Array | None = None
    ) -> None:
        """Take this instant's skeletons.

        Args:
            who: (P,) index of the prediction, -1 = new.
            exchanged: (P, G) number of views that see each limb with its sides exchanged, minus the
                number of those that see it straight. Where they are the majority for long, it is the
                skeleton that is wrong, and its sides are exchanged.
            views: (P, J) number that each joint rests on, or None: then nothing is firm.
        """
        fresh = int((who < 0).sum())
        rows = np.array(who, np.int64)
        rows[who < 0] = len(self._states) + np.arange(fresh)
        self._states = _grown(self._states, fresh, np.nan)
        self._variances = _grown(self._variances, fresh, 0.0)
        self._ages, self._unseen = _grown(self._ages, fresh, 0.0), _grown(self._unseen, fresh, 0.0)
        noise = np.trace(covariances, axis1=-2, axis2=-1) / 3.0
        self._states[rows], self._variances[rows] = update_motion(
            self._states[rows], self._variances[rows], positions, noise, START_SPEED
        )
        self._ages[rows] = np.where(np.isfinite(positions[..., 0]), 0.0, self._ages[rows])
        self._unseen[rows] = 0.0
        self._unagreed = _grown(self._unagreed, fresh, np.inf)
        if views is not None:
            self._unagreed[rows] = np.where(views >= FIRM_VIEWS, 0.0, self._unagreed[rows])
        self._balance = _grown(self._balance, fresh, 0.0)
        self._balance[rows] = BALANCE_MEMORY * self._balance[rows] + exchanged
        self._exchange_sides(self._balance > 0.0)

    def _exchange_sides(self, wrong: Array) -> None:
        """Exchange left and right of the limbs wrong (T, G)."""
        if not wrong.any():
            return
        joints = np.arange(self._joints)
        touched = wrong[:, np.maximum(self._groups, 0)] & (self._groups >= 0)
        take = np.where(touched, self._mirror, joints)
        rows = np.arange(len(wrong))[:, None]
        self._states, self._variances = self._states[rows, take], self._variances[rows, take]
        self._ages, self._unagreed = self._ages[rows, take], self._unagreed[rows, take]
        self._balance[wrong] *= -1.0


def _grown(table: Array, count: int, value: float) -> Array:
    """The table with `count` more rows of one value."""
    return np.concatenate([table, np.full((count, *table.shape[1:]), value)])
