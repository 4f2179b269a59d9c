"""How joints depend on motion, where the views of an instant have stamps of their own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain.checks import Shapes
from panoptic_ros.errors import DataError

Array = np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class TimeShift:
    """What P people of J joints rest on when their views were not taken at the same time.

    Each view was moved to the set's instant by an assumed velocity. To first order, a stated position is
    true position + delays (true velocity - assumed), with noise of the stated covariance; and the
    views say `velocities` of the velocity by themselves, independent of the position. All 0 where
    a joint is missing. With this, a filter can use every view at its own stamp.

    Args:
        delays: (P, J, 3, 3) s, mean of the views' stamps minus the instant, weighted by what each view
            says in which direction.
        assumed: (P, J, 3) m/s.
        velocities: (P, J, 3) m/s. information: (P, J, 3, 3) s^2/m^2, inverse of their covariance, may
            be singular.
    """

    delays: Array
    assumed: Array
    velocities: Array
    information: Array

    def __post_init__(self) -> None:
        shapes = Shapes(self)
        for name in ("delays", "information"):
            shapes.store(name, np.float64, "P J 3 3")
        for name in ("assumed", "velocities"):
            shapes.store(name, np.float64, "P J 3")
        for name in ("delays", "assumed", "velocities", "information"):
            if not np.isfinite(getattr(self, name)).all():
                raise DataError(f"TimeShift.{name} is not finite")

    def rows(self, which: Array | list[int]) -> TimeShift:
        """Some of the people."""
        return TimeShift(
            self.delays[which], self.assumed[which], self.velocities[which], self.information[which]
        )
