"""2D people for the live graph: simulated or recorded instants, played forth and back without an end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from panoptic_ros.domain import DetectionSet, Rig, SkeletonModel, ViewDetections
from panoptic_ros.errors import UsageError
from panoptic_ros.simulation import SKELETON, scene, simulate
from panoptic_ros.study.stage1.layouts import layout_of
from panoptic_ros.study.world import bag_world

INSTANTS = 150  # that are simulated, or read of a recording
PHASE_S = 0.004  # cameras that are not triggered together expose so much before and after


@dataclass(frozen=True, eq=False)
class Feed:
    """What cameras give.

    Args:
        sets: the views of the instants, with stamps of their own.
        rate: instants per second, Hz.
    """

    title: str
    rig: Rig
    skeleton: SkeletonModel
    sets: tuple[DetectionSet, ...]
    rate: float

    @property
    def period_ns(self) -> int:
        """Between two instants."""
        return round(1e9 / self.rate)

    def number_of_set(self, number: int) -> int:
        """Which set is played at an instant: forth, then back, so that nobody ever jumps."""
        last = len(self.sets) - 1
        return last - abs(last - number % (2 * last)) if last else 0

    def views(self, number: int) -> list[tuple[int, ViewDetections]]:
        """The views of a set, and when each comes, ns after the first; the earliest first."""
        views = sorted(self.sets[number].views, key=lambda view: view.stamp_ns)
        return [(view.stamp_ns - views[0].stamp_ns, view) for view in views]


def simulated_feed(name: str, people: int | None, views: int | None, rate: float, seed: int = 0) -> Feed:
    """A scene of the simulation whose cameras are not quite in step.

    Args:
        people, views: in place of the scene's own.

    Raises:
        UsageError: if there is no such scene, or it has no such number of people or views.
    """
    item = scene(name)
    if people is not None:
        if people < 1:
            raise UsageError(f"{people} people: the study needs one at least")
        item = replace(item, activities=tuple(np.resize(item.activities, people).tolist()))
    if views is not None:
        item = replace(item, rig=layout_of(views, len(item.activities)).rig)
    item = replace(item, timing=replace(item.timing, rate=rate, phase=PHASE_S))
    take = simulate(item, seed, INSTANTS)
    title = f"{name}, {len(take.people)} people"
    return Feed(title, take.rig, SKELETON, _whole(list(take.detection_sets()), rate), rate)


def recorded_feed(bag: Path, rate: float) -> Feed:
    """The 2D people of a bag that `panoptic run` wrote.

    Raises:
        DataError: if it has none, or is damaged.
    """
    world = bag_world(bag, frames=INSTANTS)
    return Feed(str(bag), world.rig, world.skeleton, _whole(world.sets, rate), rate)


def _whole(sets: Sequence[DetectionSet], rate: float) -> tuple[DetectionSet, ...]:
    """The sets that have views, all of which come within the period.

    Raises:
        UsageError: if cameras are too far apart for the rate.
    """
    found = tuple(item for item in sets if item.views)
    spread = max(max(v.stamp_ns for v in item.views) - min(v.stamp_ns for v in item.views) for item in found)
    if spread > 0.5e9 / rate:
        raise UsageError(
            f"views of one instant are {spread * 1e-6:.1f} ms apart, more than half of the period "
            f"at {rate:g} Hz; give a lower --rate"
        )
    return found
