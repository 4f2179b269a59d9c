"""2D people and samples of their IMUs for the live graph: simulated bodies, played forth and back."""

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

CLIPS = ("02_05", "02_10", "18_01")  # of the subjects in turn: they stay about a place
APART = 1.1  # m, of the subjects from the middle of the room


@dataclass(frozen=True, eq=False)
class BodyFeed(Feed):
    """What cameras and IMUs give.

    Args:
        devices: samples by device, of one rate: a whole number of them from one set to the next.
        subjects: who wears them.
    """

    devices: Mapping[str, ImuSeries]
    subjects: tuple[Subject, ...]

    def is_back(self, number: int) -> bool:
        """Whether an instant is played on the way back."""
        last = len(self.sets) - 1
        return bool(number % (2 * last) >= last)

    def samples(self, number: int) -> list[tuple[int, ImuSample]]:
        """Samples from an instant to the next, and when each comes, ns after it; the earliest first.

        On the way back time runs backwards: accelerations stay, rates turn round.
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
    """People with 13 IMUs each at 60 Hz, before 8 cameras.

    Args:
        rate: of the cameras, Hz, 60 or a whole part of it. seconds: until they turn back.
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
    """Every so many instants as a set, and how many instants there are to the last of them."""
    chosen = range(0, len(take.stamps), step)
    found = [
        DetectionSet(k, int(take.stamps[t]), SKELETON.hash, tuple(take.detections(t, SKELETON)))
        for k, t in enumerate(chosen)
    ]
    return tuple(found), chosen[-1] + 1


def _first(series: ImuSeries, count: int) -> ImuSeries:
    parts = series.stamps, series.quaternions, series.rates, series.forces
    return ImuSeries(*(part[:count] for part in parts))
