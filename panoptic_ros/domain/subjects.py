"""Designated people (subjects): their bodies, their IMUs, their data, and the solved body states."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain.segments import SegmentedBody

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Device:
    """IMU on a segment.

    Args:
        name: Name of the device.
        segment: Index of the segment.
        position: (3,) m in the segment's frame.
        mount: (3, 3), segment from device; None = unknown, a T-pose determines it.
    """

    name: str
    segment: int
    position: Array
    mount: Array | None


@dataclass(frozen=True, eq=False)
class TPose:
    """T-pose of the subject: times from and to in ns, and its facing direction (3,) then, or None."""

    from_ns: int
    to_ns: int
    facing: Array | None


@dataclass(frozen=True, eq=False)
class Subject:
    """One designated person.

    Args:
        start: (3,) m, pelvis position at the first instant; None = only one person is present.
        heading_known: Whether the IMUs' inertial frame is the world frame.
        measured: Whether segment lengths were measured; otherwise they follow from the stature.
        stature: m; 0 = unknown.
        assumed: The values assumed for entries that its file leaves open.
    """

    id: int
    body: SegmentedBody
    devices: tuple[Device, ...] = ()
    t_pose: TPose | None = None
    start: Array | None = None
    heading_known: bool = True
    measured: bool = True
    stature: float = 0.0
    assumed: tuple[str, ...] = ()

    def told(self) -> list[str]:
        """Return a line that states the assumed values, if there are any."""
        if not self.assumed:
            return []
        return [f"subject {self.id}: assumed, as its file does not state it: {'; '.join(self.assumed)}"]


class ViewPeople(NamedTuple):
    """2D poses of a view on the plane at distance 1: points (P, K, 2), NaN = missing; scores (P, K)."""

    points: Array
    scores: Array


@dataclass(frozen=True, eq=False)
class InstantViews:
    """2D poses of one instant, by camera index."""

    stamp_ns: int
    views: dict[int, ViewPeople]


@dataclass(frozen=True, eq=False)
class BodyState:
    """Solved body, in the world frame.

    Args:
        places: (S, 3) m of the joints.
        frames: (S, 3, 3), world from segment.
        velocities: (S, 3) m/s of the joints.
        spins: (S, 3) rad/s, angular velocities of the segments.
        covariances: (S, 6, 6) of each segment's position, m, and of a small world rotation, rad, which is
            multiplied from the left. None = unknown, e.g. if every instant is solved separately.
    """

    stamp_ns: int
    id: int
    places: Array
    frames: Array
    velocities: Array | None = None
    spins: Array | None = None
    covariances: Array | None = None


@dataclass(frozen=True, eq=False)
class ImuSeries:
    """Samples of an IMU over time.

    Args:
        stamps: (N,) ns, rising.
        quaternions: (N, 4) w x y z, inertial frame from device.
        rates: (N, 3) rad/s.
        forces: (N, 3) m/s^2. NaN = missing, in all three arrays.
    """

    stamps: Array
    quaternions: Array
    rates: Array
    forces: Array

    def shifted(self, offset_ns: int) -> ImuSeries:
        """Return the series with `offset_ns` added to its timestamps."""
        return ImuSeries(self.stamps + offset_ns, self.quaternions, self.rates, self.forces)


@dataclass(frozen=True, eq=False)
class ViewSeries:
    """2D poses of a camera over time: stamps (N,) ns, rising."""

    stamps: Array
    people: tuple[ViewPeople, ...]
