"""Skeletons propagated by the motions of their parts: steadier than measured ones, and without gaps.

Patches are placed on people by these skeletons, so that parts have patches where no view measures their
joints. Joo et al. 2017, 6.3, instead repeat the association on the filled skeleton.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain.parts import Part
from panoptic_ros.geometry.robust import growth
from panoptic_ros.geometry.rotations import rotation_of

Array = np.ndarray
FAR = 0.1  # m, scale of the Cauchy weight of a measurement's distance from the propagated position
LEAST_GAIN = 0.1  # least gain, so that wrong positions are corrected in time


@dataclass(eq=False)
class PropagatedJoints:
    """Propagated joints (J, 3) m of a person, NaN = unknown, and the time since their measurement (J,) s."""

    positions: Array
    ages: Array

    @classmethod
    def measured(cls, positions: Array) -> PropagatedJoints:
        """Return the state of a new person, from measured joints (J, 3) m."""
        return cls(positions.copy(), np.zeros(len(positions)))

    def displacements(self, parts: tuple[Part, ...], motions: dict[int, tuple[Array, Array]]) -> Array:
        """Return the displacements (J, 3) m of the joints by their parts; NaN = no part has a motion.

        A joint that several parts share gets their mean.

        Args:
            motions: Centre (3,) m and motion (6,), rotation vector and translation, by part.
        """
        sums, counts = np.zeros_like(self.positions), np.zeros(len(self.positions))
        rotation = np.empty((3, 3))
        for number, (centre, motion) in motions.items():
            joints = list(parts[number].joints)
            rotation_of(motion[:3], rotation)
            arms = self.positions[joints] - centre
            sums[joints] += np.nan_to_num(arms @ rotation.T - arms + motion[3:])
            counts[joints] += 1.0
        with np.errstate(invalid="ignore", divide="ignore"):
            moved: Array = sums / counts[:, None]
        return moved

    def take(self, moved: Array, measured: Array, dt: float, longest: float, gain: float) -> None:
        """Propagate the joints by dt s, and correct them by the measured ones.

        A joint without displacement and measurement keeps its position. After `longest` s without a
        measurement it becomes unknown.

        Args:
            moved: (J, 3) m, displacements by the parts, NaN = none.
            measured: (J, 3) m, measured joints, NaN = none.
            gain: Gain of a measurement near the propagated position; 1 = take every measurement unchanged.
        """
        there, carried = np.isfinite(measured[:, 0]), np.isfinite(moved[:, 0] + self.positions[:, 0])
        expected = np.where(carried[:, None], self.positions + np.nan_to_num(moved), self.positions)
        self.ages = np.where(there, 0.0, self.ages + dt)
        off = np.linalg.norm(measured - expected, axis=1)
        soft = gain if gain == 1.0 else np.maximum(LEAST_GAIN, gain / growth(off**2, FAR))[:, None]
        blended = expected + soft * (measured - expected)
        expected = np.where(there[:, None], np.where(carried[:, None], blended, measured), expected)
        self.positions = np.where((self.ages <= longest)[:, None], expected, np.nan)
