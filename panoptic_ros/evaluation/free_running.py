"""Check whether the cameras of a recording expose at different times and are too slow to be grouped."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import DetectionSet

Array = np.ndarray
SLOW_S = 0.045  # s; at 25 Hz and more, views keep close enough to the instant of their set
APART_S = 0.01  # s; clocks and timers scatter synchronous cameras by less
TELLING = 10  # minimum number of sets with several views
NORMAL = 4.0  # ratio of the range of evenly spread times to their median distance from the middle


class FreeRun(NamedTuple):
    """Cameras that are not synchronous: typical period (s), and time between the views of a set (s)."""

    period: float
    apart: float

    def __str__(self) -> str:
        return (
            f"cameras of {1.0 / self.period:.1f} Hz expose {1e3 * self.apart:.0f} ms apart, which loses fast "
            "motion in sets of views"
        )


def free_running(sets: Sequence[DetectionSet]) -> FreeRun | None:
    """Return how far views of a set are apart if cameras are slow and not synchronous; else None.

    A single camera whose clock is wrong does not count.
    """
    stamps: dict[str, list[int]] = {}
    apart = []
    for item in sets:
        for view in item.views:
            stamps.setdefault(view.camera, []).append(view.stamp_ns)
        if len(item.views) > 1:
            apart.append(_spread(np.array([view.stamp_ns - item.stamp_ns for view in item.views])))
    periods = [float(np.median(np.diff(np.sort(own)))) for own in stamps.values() if len(own) > 1]
    if len(apart) < TELLING or not periods:
        return None
    found = FreeRun(1e-9 * float(np.median(periods)), 1e-9 * float(np.median(apart)))
    return found if found.period > SLOW_S and found.apart > APART_S else None


def _spread(stamps: Array) -> float:
    """Return the range of timestamps (V,), or less if few of them are far from the others."""
    middle = float(np.median(np.abs(stamps - np.median(stamps))))
    return min(float(np.ptp(stamps)), NORMAL * middle)
