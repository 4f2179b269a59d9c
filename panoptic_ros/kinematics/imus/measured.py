"""Measurements of a person's IMUs at an instant as rows, and samples of a device at a fixed rate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain.subjects import Device, ImuSeries
from panoptic_ros.geometry.rotations import from_quaternions

Array = np.ndarray

LONGEST_GAP_S = 0.1  # longest interval between two samples of an IMU over which it is interpolated


class ImuMeasurements(NamedTuple):
    """Measurements of D devices, in their order.

    Attributes:
        there: (D,), True if the device measured anything.
        orientations: (D, 3, 3), inertial frame from device; NaN = not measured.
        forces: (D, 3) m/s^2, specific forces in the device frame; NaN = not measured.
    """

    there: Array
    orientations: Array
    forces: Array

    def rows(self, which: Array) -> ImuMeasurements:
        """Return the measurements of devices `which` (N,)."""
        return ImuMeasurements(self.there[which], self.orientations[which], self.forces[which])

    @property
    def oriented(self) -> Array:
        """Return which devices (D,) measured their orientation."""
        found: Array = self.there & np.isfinite(self.orientations[:, 0, 0])
        return found


NOTHING_MEASURED = ImuMeasurements(np.zeros(0, bool), np.zeros((0, 3, 3)), np.zeros((0, 3)))


def resample(series: ImuSeries, stamps: Array) -> ImuMeasurements:
    """Return the measurements of a device at instants (T,) ns, one row per instant.

    Rows without samples around the instant are marked as not there.
    """
    if len(series.stamps) < 2:
        return _nothing(len(stamps))
    after = np.clip(np.searchsorted(series.stamps, stamps), 1, len(series.stamps) - 1)
    before = after - 1
    gap = series.stamps[after] - series.stamps[before]
    share = (stamps - series.stamps[before]) / np.maximum(gap, 1)
    usable = (share > -0.5) & (share < 1.5) & (gap < LONGEST_GAP_S * 1e9)
    share = np.clip(share, 0.0, 1.0)[:, None]
    forces = series.forces[before] * (1 - share) + series.forces[after] * share
    with np.errstate(invalid="ignore"):
        turns = from_quaternions(slerp(series.quaternions[before], series.quaternions[after], share))
    turns[~usable], forces[~usable] = np.nan, np.nan
    return ImuMeasurements(usable, turns, forces)


def measured_by(
    devices: Sequence[Device], felt: Mapping[str, ImuMeasurements], count: int
) -> list[ImuMeasurements]:
    """Return the measurements of these devices at each of `count` instants.

    Args:
        felt: Measurements by device name, see `resample`.
    """
    if not devices:
        return [NOTHING_MEASURED] * count
    own = [felt.get(device.name, _nothing(count)) for device in devices]
    return [ImuMeasurements(*row) for row in zip(*(np.stack(part, axis=1) for part in zip(*own)))]


def _nothing(count: int) -> ImuMeasurements:
    """Return `count` rows without any measurement."""
    return ImuMeasurements(np.zeros(count, bool), np.full((count, 3, 3), np.nan), np.full((count, 3), np.nan))


def slerp(begin: Array, end: Array, share: Array) -> Array:
    """Return quaternions (N, 4) between two sets (N, 4), along the shorter arc.

    Args:
        share: (N, 1), fraction of the arc.
    """
    cosine = (begin * end).sum(-1, keepdims=True)
    end = np.where(cosine < 0.0, -end, end)
    angle = np.arccos(np.clip(np.abs(cosine), 0.0, 1.0))
    flat = angle < 1e-4
    sine = np.where(flat, 1.0, np.sin(angle))
    found: Array = np.where(
        flat,
        (1 - share) * begin + share * end,
        (np.sin((1 - share) * angle) * begin + np.sin(share * angle) * end) / sine,
    )
    return found
