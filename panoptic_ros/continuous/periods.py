"""Periods of the cameras, from the newest frames."""

from __future__ import annotations

from collections import deque

from panoptic_ros.continuous.follow import pairing_time_of

KEPT_STEPS = 9  # number of newest times between frames whose median is the period of a camera
LONGEST_STEP_S = 1.0  # s; a longer time between frames is a pause
USUAL_PERIOD_S = 0.1  # s, period before any camera has given two frames


class CameraPeriods:
    """Times between the frames of each camera, from the newest ones."""

    def __init__(self) -> None:
        self._last: dict[int, float] = {}  # s, by camera
        self._steps: dict[int, deque[float]] = {}  # s, by camera
        self._periods: dict[int, float] = {}  # s, by camera, median of the steps

    def take(self, camera: int, time: float) -> None:
        """Add the time (s) of a frame; times of a camera increase."""
        last = self._last.get(camera)
        self._last[camera] = time
        if last is None or time - last > LONGEST_STEP_S:
            return
        steps = self._steps.setdefault(camera, deque(maxlen=KEPT_STEPS))
        steps.append(time - last)
        self._periods[camera] = sorted(steps)[len(steps) // 2]

    @property
    def pairing_time(self) -> float:
        """Return the time (s) between two views that may start a person."""
        return pairing_time_of(self._periods.values())

    @property
    def typical(self) -> float:
        """Return the typical period (s) of a camera."""
        periods = sorted(self._periods.values())
        return periods[len(periods) // 2] if periods else USUAL_PERIOD_S
