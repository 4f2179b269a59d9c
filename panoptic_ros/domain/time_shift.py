"""Dependence of joint positions on motion, where 2D joints of an instant were exposed at different times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain.checks import ShapeChecks
from panoptic_ros.errors import DataError

Array = np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class TimeShift:
    """First-order dependence of the joints of P people on their velocity, if views differ in time.

    Each view was moved to the set's instant with an assumed velocity. To first order, a stated position is
    true position + delays (true velocity - assumed), with noise of the stated covariance. The views also
    measure `velocities`, independently of the position. All arrays are 0 where a joint is missing. A filter
    can use this to take every view at its own timestamp.

    Args:
        delays: (P, J, 3, 3) s, mean of the exposures of the 2D joints minus the instant, weighted by their
            information in each direction.
        assumed: (P, J, 3) m/s, assumed velocity.
        velocities: (P, J, 3) m/s, measured velocity.
        information: (P, J, 3, 3) s^2/m^2, inverse covariance of `velocities`, may be singular.
    """

    delays: Array
    assumed: Array
    velocities: Array
    information: Array

    def __post_init__(self) -> None:
        shapes = ShapeChecks(self)
        for name in ("delays", "information"):
            shapes.store(name, np.float64, "P J 3 3")
        for name in ("assumed", "velocities"):
            shapes.store(name, np.float64, "P J 3")
        for name in ("delays", "assumed", "velocities", "information"):
            if not np.isfinite(getattr(self, name)).all():
                raise DataError(f"TimeShift.{name} is not finite")

    def rows(self, which: Array | list[int]) -> TimeShift:
        """Return the people with these indices."""
        return TimeShift(
            self.delays[which], self.assumed[which], self.velocities[which], self.information[which]
        )
