"""2D poses and IMU samples for the live graph: simulated bodies, played forward and backward."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from panoptic_ros.domain import DetectionSet, ImuSample
from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.domain.subjects import ImuSeries, Subject
from panoptic_ros.simulation import SKELETON
from panoptic_ros.simulation.bodies.capture import BodyScene
from panoptic_ros.simulation.bodies.group import BodyGroup, simulate_group
from panoptic_ros.simulation.bodies.motion import Clip
from panoptic_ros.study.live.graph_feed import Feed

# clips of the subjects in turn; in all clips the person stays near one place
CLIPS = ("02_05", "02_10", "18_01")
APART = 1.1  # m, distance of the subjects from the middle of the room


@dataclass(frozen=True, eq=False)
class BodyFeed(Feed):
    """Data of cameras and IMUs.

    Args:
        devices: samples by device, all at one rate that is a multiple of the rate of sets.
        subjects: wearers of the devices.
    """

    devices: Mapping[str, ImuSeries]
    subjects: tuple[Subject, ...]

    def is_back(self, number: int) -> bool:
        """Return whether a time step is played backward."""
        last = len(self.sets) - 1
        return bool(number % (2 * last) >= last)

    def samples(self, number: int) -> list[tuple[int, ImuSample]]:
        """Return the samples from one time step to the next with their delays (ns), in order of time.

        In backward playback time is reversed: accelerations stay, angular rates change their sign.
        """
        found, first = [], self.number_of_set(number)
        back = self.is_back(number)
        for name, series in self.devices.items():
            each = (len(series.stamps) - 1) // (len(self.sets) - 1)
            for j in range(each):
                k = first * each + (-j if back else j)
                rate = -series.rates[k] if back else series.rates[k]
                sample = ImuSample(name, 0, series.quaternions[k], rate, series.forces[k])
                found.append((round(j * self.period_ns / each), sample))
        return sorted(found, key=lambda row: row[0])


def body_feed(
    people: int, rate: float, seconds: float, seed: int, model: SegmentModel, clips: Mapping[str, Clip]
) -> BodyFeed:
    """Simulate persons with 13 IMUs each at 60 Hz, in 8 cameras.

    Args:
        rate: camera rate, Hz; 60 or an integer fraction of it.
        seconds: duration of the forward playback.
    """
    angles = 2.0 * np.pi * np.arange(people) / people
    radius = APART if people > 1 else 0.0
    scenes = [
        BodyScene(
            (CLIPS[k % len(CLIPS)],),
            seconds=seconds,
            facing=float(np.degrees(angle)),
            at=(radius * float(np.cos(angle)), radius * float(np.sin(angle))),
        )
        for k, angle in enumerate(angles)
    ]
    take = simulate_group(replace(scenes[0], others=tuple(scenes[1:])), seed, model, clips)
    sets, count = _sets(take, round(scenes[0].rate / rate))
    devices = {name: _first(series, count) for name, series in take.devices.items()}
    title = f"{len(take.subjects)} bodies with {len(devices)} IMUs at {scenes[0].rate:g} Hz"
    return BodyFeed(title, take.rig, SKELETON, sets, rate, devices, take.subjects)


def _sets(take: BodyGroup, step: int) -> tuple[tuple[DetectionSet, ...], int]:
    """Return every `step`-th time step as a set, and the number of time steps up to the last set."""
    chosen = range(0, len(take.stamps), step)
    found = [
        DetectionSet(k, int(take.stamps[t]), SKELETON.hash, tuple(take.detections(t, SKELETON)))
        for k, t in enumerate(chosen)
    ]
    return tuple(found), chosen[-1] + 1


def _first(series: ImuSeries, count: int) -> ImuSeries:
    parts = series.stamps, series.quaternions, series.rates, series.forces
    return ImuSeries(*(part[:count] for part in parts))
