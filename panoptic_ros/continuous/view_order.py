"""Order of the views of several cameras that arrive one by one, and the time up to which it is known."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

from panoptic_ros.solving.frames import CameraFrame

SECOND = 1_000_000_000
START_NS = SECOND  # ns, longest wait for the first view of every camera
STEP_NS = (
    SECOND  # ns, longest step between views that counts as a period, and the period before the first one
)
LEAST_AHEAD_NS = SECOND // 4  # ns; a view farther ahead of most cameras, and by two periods, is left out
PERIODS_AHEAD = 2
NEAR_NS = 2 * SECOND  # ns, longest correction of a timestamp on the common clock; longer ones join two clocks
JOINED_NS = SECOND // 50  # ns, by which the order of views on joined clocks may be wrong
RECENT = 4  # number of newest views per camera of the rig by which silent cameras are recognised


class TimedFrame(NamedTuple):
    """View that waits, at its corrected time in ns."""

    time_ns: int
    camera: int
    frame: CameraFrame


class ViewOrder:
    """Buffer of views until no earlier one can come.

    Views come in the order of their timestamps, or at most `wait_ns` out of order. Corrections of timestamps
    change that order, by their differences between cameras.

    Args:
        cameras: (C) names.
    """

    def __init__(self, cameras: Sequence[str], wait_ns: int):
        self._cameras, self._wait_ns = tuple(cameras), wait_ns
        self._waiting: list[TimedFrame] = []
        self._newest: dict[int, int] = {}  # ns by camera
        self._steps: dict[int, int] = {}  # ns by camera, between its two newest views
        self._shifts: dict[int, int] = {}  # ns by camera, correction of its newest view
        self._recent: deque[int] = deque(maxlen=RECENT * len(self._cameras))  # cameras of the newest views
        self._begin_ns: int | None = None  # time of the first view
        self.taken_ns: int | None = None  # all views up to this time were taken

    def put(self, view: TimedFrame, shift_ns: int) -> str:
        """Add a view; return why it is left out: "back", "late" or "ahead", "" if it is not.

        Args:
            shift_ns: correction that its time contains.
        """
        camera, time_ns = view.camera, view.time_ns
        last = self._newest.get(camera)
        if last is not None and time_ns <= last:
            return "back"
        self._steps[camera] = STEP_NS if last is None else min(time_ns - last, STEP_NS)
        self._newest[camera], self._shifts[camera] = time_ns, shift_ns
        self._recent.append(camera)
        if self._begin_ns is None:
            self._begin_ns = time_ns
        if self.taken_ns is not None and time_ns <= self.taken_ns:
            return "late"
        if time_ns > self._limit_ns():
            return "ahead"
        self._waiting.append(view)
        return ""

    @property
    def known_ns(self) -> int | None:
        """Return the time before which no further views are expected; None at the beginning."""
        if self._begin_ns is None:
            return None
        limit = self._limit_ns()
        newest = max(time for time in self._alive() if time <= limit)
        if self.taken_ns is None and len(self._newest) < len(self._cameras):
            if newest - self._begin_ns < START_NS:
                return None
        shifts = [self._shifts[camera] for camera in set(self._recent)]
        near = [shift for shift in shifts if abs(shift) <= NEAR_NS]
        disorder = max(near, default=0) - min(near, default=0)
        disorder += JOINED_NS if len(near) < len(shifts) else 0
        return newest - self._wait_ns - disorder

    @property
    def next_ns(self) -> int | None:
        """Return the earliest time of a view that waits."""
        return min((view.time_ns for view in self._waiting), default=None)

    @property
    def last_ns(self) -> int | None:
        """Return the latest time of a view that waits."""
        return max((view.time_ns for view in self._waiting), default=None)

    def take(self, until_ns: int) -> list[TimedFrame]:
        """Remove and return the views up to a time, in order."""
        due = sorted((view for view in self._waiting if view.time_ns <= until_ns), key=lambda view: view[:2])
        if due:
            self._waiting = [view for view in self._waiting if view.time_ns > until_ns]
        self.taken_ns = until_ns if self.taken_ns is None else max(until_ns, self.taken_ns)
        return due

    def _alive(self) -> list[int]:
        """Return the sorted newest times of the cameras that are not silent."""
        return sorted(self._newest[camera] for camera in set(self._recent))

    def _limit_ns(self) -> int:
        """Return the time beyond which a view is far ahead of most cameras."""
        alive = self._alive()
        period = max(self._steps[camera] for camera in set(self._recent))
        return alive[(len(alive) - 1) // 2] + max(LEAST_AHEAD_NS, PERIODS_AHEAD * period)
