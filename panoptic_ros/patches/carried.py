"""Skeletons that are carried on by the motion of their parts: steadier than measured ones, and without gaps.

Patches are put on people by these, so that they find their part where no view measures its joints (Joo et al.
2017, 6.3, associate anew on the filled skeleton).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain.parts import Part
from panoptic_ros.geometry.robust import growth
from panoptic_ros.geometry.rotations import rotation_of

Array = np.ndarray
FAR = 0.1  # m, of a measurement from what is carried, from which on it counts less
LEAST_GAIN = 0.1  # whatever it is, so that what is wrong does not stay


@dataclass(eq=False)
class Carried:
    """Joints (J, 3) m of a person, NaN = not known, and for how long they are carried (J,) s."""

    positions: Array
    ages: Array

    @classmethod
    def measured(cls, positions: Array) -> Carried:
        """Of somebody new."""
        return cls(positions.copy(), np.zeros(len(positions)))

    def displacements(self, parts: tuple[Part, ...], motions: dict[int, tuple[Array, Array]]) -> Array:
        """How far (J, 3) m parts carry the joints, the mean of the parts that share one; NaN = none does.

        Args:
            motions: by part: centre (3,) m and motion (6,), rotation vector and translation.
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
        """Go on by dt s: moved (J, 3) m by their parts, measured (J, 3) m, NaN = not.

        What is neither measured nor moved stays where it is; after `longest` s without a measurement a joint
        is not known. gain: of a measurement that is near; 1 = of every one.
        """
        there, carried = np.isfinite(measured[:, 0]), np.isfinite(moved[:, 0] + self.positions[:, 0])
        expected = np.where(carried[:, None], self.positions + np.nan_to_num(moved), self.positions)
        self.ages = np.where(there, 0.0, self.ages + dt)
        off = np.linalg.norm(measured - expected, axis=1)
        soft = gain if gain == 1.0 else np.maximum(LEAST_GAIN, gain / growth(off**2, FAR))[:, None]
        blended = expected + soft * (measured - expected)
        expected = np.where(there[:, None], np.where(carried[:, None], blended, measured), expected)
        self.positions = np.where((self.ages <= longest)[:, None], expected, np.nan)
