"""2D poses for the live graph: simulated or recorded sets, played forward and backward without end."""

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

INSTANTS = 150  # number of sets to simulate or to read from a recording
PHASE_S = 0.004  # s, cameras start uniformly within +- this, as without a common trigger


@dataclass(frozen=True, eq=False)
class Feed:
    """Data of the cameras.

    Args:
        sets: detection sets; their views have timestamps of their own.
        rate: sets per second, Hz.
    """

    title: str
    rig: Rig
    skeleton: SkeletonModel
    sets: tuple[DetectionSet, ...]
    rate: float

    @property
    def period_ns(self) -> int:
        """Return the time between two sets (ns)."""
        return round(1e9 / self.rate)

    def number_of_set(self, number: int) -> int:
        """Return the set to play at a time step: forward, then backward, so that no person jumps."""
        last = len(self.sets) - 1
        return last - abs(last - number % (2 * last)) if last else 0

    def views(self, number: int) -> list[tuple[int, ViewDetections]]:
        """Return the views of a set, each with its delay (ns) after the first, in order of time."""
        views = sorted(self.sets[number].views, key=lambda view: view.stamp_ns)
        return [(view.stamp_ns - views[0].stamp_ns, view) for view in views]


def simulated_feed(name: str, people: int | None, views: int | None, rate: float, seed: int = 0) -> Feed:
    """Simulate a scene with slightly unsynchronised cameras.

    Args:
        people: number of persons instead of the scene's.
        views: number of views instead of the scene's.

    Raises:
        UsageError: if the scene does not exist, or cannot have this number of persons or views.
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
    """Read the 2D poses of a bag that `panoptic run` wrote.

    Raises:
        DataError: if it has none, or is damaged.
    """
    world = bag_world(bag, frames=INSTANTS)
    return Feed(str(bag), world.rig, world.skeleton, _whole(world.sets, rate), rate)


def _whole(sets: Sequence[DetectionSet], rate: float) -> tuple[DetectionSet, ...]:
    """Return the sets that have views, after a check that the views of a set lie within half a period.

    Raises:
        UsageError: if the views of a set are too far apart in time for the rate.
    """
    found = tuple(item for item in sets if item.views)
    spread = max(max(v.stamp_ns for v in item.views) - min(v.stamp_ns for v in item.views) for item in found)
    if spread > 0.5e9 / rate:
        raise UsageError(
            f"views of one instant are {spread * 1e-6:.1f} ms apart, more than half of the period "
            f"at {rate:g} Hz; give a lower --rate"
        )
    return found
