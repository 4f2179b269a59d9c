"""Order of the views of several cameras that arrive one by one, and the time up to which it is known."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from panoptic_ros.solving.frames import CameraFrame

SECOND = 1_000_000_000
START_NS = SECOND  # ns, longest wait for the first two views of every camera
STEP_NS = SECOND  # ns, longest step between views that counts as a period; the period before any is known
# periods without a view after which a camera is silent; periods by which a view may be ahead of most cameras
# (more, as other cameras may just have stopped); lower limit of that time, ns
SILENT, AHEAD, LEAST_AHEAD_NS = 3, 5, SECOND // 4
NEAR_NS = 2 * SECOND  # ns, longest correction of a timestamp on the common clock; longer ones join two clocks
JOINED_NS = SECOND // 50  # ns, tolerance of the order of views on joined clocks
# ns; if the newest views of most cameras are earlier than taken ones by more, their clocks were set back
SET_BACK_NS = SECOND


class TimedFrame(NamedTuple):
    """View that waits, at its corrected time in ns."""

    time_ns: int
    camera: int
    frame: CameraFrame


class ViewOrder:
    """Buffer of views until no earlier one can come.

    Views come in the order of their timestamps, or at most `wait_ns` out of order. Corrections of timestamps
    change that order, by their differences between cameras. If the clocks of most cameras are set back, times
    continue from the newest one.

    Args:
        cameras: (C) names.
    """

    def __init__(self, cameras: Sequence[str], wait_ns: int):
        self._cameras, self._wait_ns = tuple(cameras), wait_ns
        self._waiting: list[TimedFrame] = []
        # ns, time of the newest view by camera, including views that are left out
        self._newest: dict[int, int] = {}
        self._accepted: dict[int, int] = {}  # ns, time of the newest view by camera that is not left out
        self._steps: dict[int, int] = {}  # ns, period by camera
        self._corrections: dict[int, int] = {}  # ns, correction of the newest view by camera
        self._counts: dict[int, int] = {}  # number of views by camera
        self._others: dict[int, dict[int, int]] = {}  # `_counts` at the newest view of each camera
        self._silent: set[int] = set()  # cameras of which no view has come for a few periods
        self._begin_ns: int | None = None  # time of the first view
        self._shift_ns = 0  # added to all times, because clocks were set back
        self.taken_ns: int | None = None  # all views up to this time were taken

    def put(self, view: TimedFrame, correction_ns: int) -> str:
        """Add a view; return why it is left out: "back", "late" or "ahead", "" if it is not.

        Args:
            correction_ns: correction that its time contains.
        """
        view = view._replace(time_ns=view.time_ns + self._shift_ns)
        camera, time_ns = view.camera, view.time_ns
        step = time_ns - self._newest.get(camera, time_ns)
        if 0 < step <= STEP_NS:
            self._steps[camera] = step
        self._newest[camera], self._corrections[camera] = time_ns, correction_ns
        self._count(camera)
        if self.taken_ns is None:
            self._begin_ns = time_ns if self._begin_ns is None else min(self._begin_ns, time_ns)
        elif self._are_set_back(self.taken_ns):
            back_ns = self.taken_ns + 1 - self._alive_times()[0]
            self._shift_ns += back_ns
            self._newest = {number: time + back_ns for number, time in self._newest.items()}
            view = view._replace(time_ns=time_ns + back_ns)
            time_ns = view.time_ns
        last = self._accepted.get(camera)
        if last is not None and time_ns <= last:
            return "back"
        if self.taken_ns is not None and time_ns <= self.taken_ns:
            return "late"
        if time_ns > self._limit_ns():
            return "ahead"
        self._accepted[camera] = time_ns
        self._waiting.append(view)
        return ""

    @property
    def known_ns(self) -> int | None:
        """Return the time before which no further views are expected; None at the beginning."""
        if self._begin_ns is None:
            return None
        times, limit = self._alive_times(), self._limit_ns()
        if self.taken_ns is None and times[(len(times) - 1) // 2] - self._begin_ns < START_NS:
            if sum(count > 1 for count in self._counts.values()) < len(self._cameras):
                return None
        newest = max(time for time in times if time <= limit)
        corrections = [self._corrections[camera] for camera in self._alive()]
        near = [correction for correction in corrections if abs(correction) <= NEAR_NS]
        disorder = max(near, default=0) - min(near, default=0)
        disorder += JOINED_NS if len(near) < len(corrections) else 0
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

    def _count(self, camera: int) -> None:
        """Count a view, and mark cameras as silent that gave no view for several of their periods."""
        count = self._counts[camera] = self._counts.get(camera, 0) + 1
        self._others[camera] = dict(self._counts)
        self._silent.discard(camera)
        own = self._steps.get(camera, STEP_NS)
        for other, before in self._others.items():
            views = max(1.0, self._steps.get(other, STEP_NS) / own)  # by this camera in a period of the other
            if count - before.get(camera, 0) > SILENT * views:
                self._silent.add(other)

    def _alive(self) -> list[int]:
        """Return the cameras that are not silent."""
        return [camera for camera in self._counts if camera not in self._silent]

    def _alive_times(self) -> list[int]:
        """Return the sorted newest times of the cameras that are not silent."""
        return sorted(self._newest[camera] for camera in self._alive())

    def _are_set_back(self, taken_ns: int) -> bool:
        """Return whether the newest times of most cameras are far behind views that were taken."""
        times = self._alive_times()
        return times[len(times) // 2] < taken_ns - SET_BACK_NS

    def _limit_ns(self) -> int:
        """Return the time beyond which a view is far ahead of most cameras."""
        times = self._alive_times()
        steps = [self._steps[camera] for camera in self._alive() if camera in self._steps]
        return times[(len(times) - 1) // 2] + max(LEAST_AHEAD_NS, AHEAD * max(steps, default=STEP_NS))
