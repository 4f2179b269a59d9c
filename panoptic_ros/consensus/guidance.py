"""Temporal guidance: predictions of the skeletons that were found in the instants before."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.consensus.guidance_steps import predict_people, update_people

Array = np.ndarray
Tables = tuple[Array, Array, Array, Array, Array, Array]  # see `Guidance.clear`

START_SPEED = 1.5  # m/s, standard deviation of the velocity of a new joint
FADE_TIME = 0.15  # s, over which the predicted velocity of an unseen joint fades
LOST_SIGMA = 0.35  # m, joints whose prediction is less certain are forgotten
FIRM_VIEWS = 3  # views that must agree on a joint to make its position firm
FIRM_TIME = 0.08  # s, how long it stays firm
ESTABLISHED_JOINTS = 4  # joints that were ever firm make a person established
GUIDANCE_FIELDS = (  # all attributes of a Guidance, for the layouts of states that hold one
    "_joints _mirror _groups _memory _acceleration _states _variances _ages _unagreed _unseen _balance"
)
OF_NEW = (np.nan, 0.0, 0.0, 0.0, np.inf, 0.0)  # what the tables hold for a new person before the first update
BALANCE_MEMORY = 0.9  # per frame, decay of the balance of exchanged and straight views of a limb


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """Predicted motion of P people.

    positions: (P, J, 3) m, NaN = unknown. velocities: (P, J, 3) m/s, 0 where unknown.
    ages: (P, J) s since measured. variances: (P, J, 3), see `geometry.motion`.
    firm: (P, J) whether three or more views agreed on the joint a moment ago.
    established: (P,) whether three or more views ever agreed on some joints.
    """

    positions: Array
    velocities: Array
    ages: Array
    variances: Array
    firm: Array
    established: Array


class Guidance:
    """A constant-velocity Kalman filter for each joint of each person.

    It is used for choices only (association, starting points, sides, time shifts). The positions that
    assembly gives are functions of the present images.
    """

    def __init__(self, mirror: Array, groups: Array, memory: float, acceleration: float):
        self._joints, self._mirror, self._groups = len(mirror), mirror, groups
        self._memory, self._acceleration = float(memory), acceleration
        self.clear()

    def clear(self) -> None:
        """Forget everybody."""
        self._states = np.empty((0, self._joints, 6))
        self._variances = np.empty((0, self._joints, 3))
        self._ages = np.empty((0, self._joints))
        self._unagreed = np.empty((0, self._joints))  # s since FIRM_VIEWS views agreed
        self._unseen = np.empty(0)  # s since the person was seen
        self._balance = np.empty((0, self._groups.max(initial=-1) + 1))  # exchanged minus straight views

    @property
    def _tables(self) -> Tables:
        """All tables, in the order of the kernels."""
        return (
            self._states, self._variances, self._ages, self._unseen, self._unagreed, self._balance
        )  # fmt: skip

    def _take(self, tables: Tables) -> None:
        """Replace all tables."""
        (
            self._states, self._variances, self._ages, self._unseen, self._unagreed, self._balance
        ) = tables  # fmt: skip

    def predict(self, dt: float) -> Prediction:
        """Predict to dt >= 0 s later, and drop people who were not seen for long."""
        noise = self._acceleration**2
        growth = (noise * dt**4 / 4.0, noise * dt**3 / 2.0, noise * dt**2)
        self._take(
            predict_people(
                *self._tables, float(dt), float(np.exp(-dt / FADE_TIME)), growth, LOST_SIGMA**2, self._memory
            )
        )
        velocities = np.where(np.isfinite(self._states[..., :1]), self._states[..., 3:], 0.0)
        return Prediction(
            self._states[..., :3].copy(), velocities, self._ages.copy(), self._variances.copy(),
            self._unagreed <= FIRM_TIME, np.isfinite(self._unagreed).sum(axis=1) >= ESTABLISHED_JOINTS,
        )  # fmt: skip

    def update(
        self, who: Array, positions: Array, covariances: Array, exchanged: Array, views: Array | None = None
    ) -> None:
        """Update with the skeletons of this instant.

        Args:
            who: (P,) index of the prediction, -1 = new.
            exchanged: (P, G) number of views that see each limb with its sides exchanged, minus the
                number of those that see it straight. If they are the majority for long, the skeleton is
                wrong, and its sides are exchanged.
            views: (P, J) number of inlier views of each joint, or None: then nothing is firm.
        """
        firm = np.zeros(positions.shape[:2], bool) if views is None else views >= FIRM_VIEWS
        self._take(grown(self._tables, int((who < 0).sum())))
        update_people(
            *self._tables, who, positions, covariances, exchanged, firm, START_SPEED, BALANCE_MEMORY
        )
        self._exchange_sides(self._balance > 0.0)

    def _exchange_sides(self, wrong: Array) -> None:
        """Exchange left and right of the limbs of people `wrong` (T, G)."""
        if not wrong.any():
            return
        joints = np.arange(self._joints)
        touched = wrong[:, np.maximum(self._groups, 0)] & (self._groups >= 0)
        take = np.where(touched, self._mirror, joints)
        rows = np.arange(len(wrong))[:, None]
        self._states, self._variances = self._states[rows, take], self._variances[rows, take]
        self._ages, self._unagreed = self._ages[rows, take], self._unagreed[rows, take]
        self._balance[wrong] *= -1.0


def grown(tables: Tables, count: int) -> Tables:
    """Copies of the tables with so many more rows."""
    states, variances, ages, unseen, unagreed, balance = (
        np.concatenate([table, np.full((count, *table.shape[1:]), value)])
        for table, value in zip(tables, OF_NEW)
    )
    return states, variances, ages, unseen, unagreed, balance
