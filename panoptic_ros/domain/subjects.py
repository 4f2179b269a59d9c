"""Designated people: their bodies, the IMUs on them, their data, and what is solved."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain.segments import Body

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Device:
    """An IMU on a segment.

    Args:
        segment: index. position: (3,) m in its frame.
        mount: (3, 3), segment from device; None = unknown, a T-pose tells it.
    """

    name: str
    segment: int
    position: Array
    mount: Array | None


@dataclass(frozen=True, eq=False)
class TPose:
    """When the subject stands in a T, from and to in ns, and where it faces then, (3,) or None."""

    from_ns: int
    to_ns: int
    facing: Array | None


@dataclass(frozen=True, eq=False)
class Subject:
    """One designated person.

    Args:
        start: (3,) m, where the pelvis is at the first instant; None = only one person is there.
        heading_known: whether the IMUs' inertial frame is the world's.
        measured: whether lengths were measured; else they are those of the stature.
        stature: m; 0 = not known.
        assumed: how what its file leaves open is taken.
    """

    id: int
    body: Body
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
        return [f"subject {self.id}: taken, as its file does not say: {'; '.join(self.assumed)}"]


class ViewPeople(NamedTuple):
    """2D people of a view on the plane at distance 1: points (P, K, 2), NaN = missing; scores (P, K)."""

    points: Array
    scores: Array


@dataclass(frozen=True, eq=False)
class Instant:
    """2D people of one instant by the index of the camera."""

    stamp_ns: int
    views: dict[int, ViewPeople]


@dataclass(frozen=True, eq=False)
class BodyState:
    """A solved body, everything in the world.

    Args:
        places: (S, 3) m of the joints. frames: (S, 3, 3), world from segment.
        velocities: (S, 3) m/s of the joints. spins: (S, 3) rad/s, angular velocities of the segments.
        covariances: (S, 6, 6) of place, m, and of a small rotation from the left, rad, of each segment.
            None = not known, as where every instant is solved alone.
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
    """Samples of a device by time.

    Args:
        stamps: (N,) ns, rising. quaternions: (N, 4) w x y z, inertial frame from device; rates: (N, 3) rad/s;
            forces: (N, 3) m/s^2; NaN = not there.
    """

    stamps: Array
    quaternions: Array
    rates: Array
    forces: Array

    def shifted(self, offset_ns: int) -> ImuSeries:
        """With stamps that are later by so much."""
        return ImuSeries(self.stamps + offset_ns, self.quaternions, self.rates, self.forces)


@dataclass(frozen=True, eq=False)
class ViewSeries:
    """2D people of a camera by time: stamps (N,) ns, rising."""

    stamps: Array
    people: tuple[ViewPeople, ...]
