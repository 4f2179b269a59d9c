"""What the IMUs of somebody measured at an instant, as rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain.subjects import Device, ImuReading

Array = np.ndarray


class Measured(NamedTuple):
    """Of D devices in their order: whether each told anything (D,), orientations (D, 3, 3), inertial frame
    from device, and specific forces (D, 3) m/s^2 in the device's frame; NaN = not told."""

    there: Array
    orientations: Array
    forces: Array

    def rows(self, which: Array) -> Measured:
        """Of some devices (N,)."""
        return Measured(self.there[which], self.orientations[which], self.forces[which])

    @property
    def oriented(self) -> Array:
        """Which devices (D,) told their orientation."""
        found: Array = self.there & np.isfinite(self.orientations[:, 0, 0])
        return found


NOTHING_MEASURED = Measured(np.zeros(0, bool), np.zeros((0, 3, 3)), np.zeros((0, 3)))


def measured_of(devices: Sequence[Device], readings: Mapping[str, ImuReading]) -> Measured:
    """What these devices measured, of readings by name."""
    there = np.array([device.name in readings for device in devices], bool)
    orientations, forces = np.full((len(devices), 3, 3), np.nan), np.full((len(devices), 3), np.nan)
    for k in np.flatnonzero(there).tolist():
        reading = readings[devices[k].name]
        orientations[k], forces[k] = reading.orientation, reading.force
    return Measured(there, orientations, forces)
