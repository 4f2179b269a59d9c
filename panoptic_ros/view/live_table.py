"""Live status table of cameras, people and latency in a terminal."""

from __future__ import annotations

import shutil
import sys
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import TextIO

import numpy as np

from panoptic_ros.domain import SkeletonModel, TrackedPoseSet
from panoptic_ros.io.colors import rgb_of
from panoptic_ros.view.redrawn import RedrawnLines

WINDOW_S = 2.0  # s; window over which frame rates are counted
REDRAW_S = 0.25  # s between redraws of the table in a terminal
LINE_S = 2.0  # s between plain lines when the stream is not a terminal


class LiveTable:
    """Terminal table of cameras, people and latency, redrawn in place.

    Each camera row has the frame rate and the number of detected people. Each person row has the id, the head
    position and the number of found joints. The last row has the latency and the number of dropped frames and
    messages. If the stream is not a terminal, the table prints one plain line every 2 s instead. Not
    thread-safe: call it from one thread.

    Args:
        cameras: Camera names, in order.
        skeleton: Skeleton of the poses.
        stream: Output stream. Default: sys.stdout.
        clock: Monotonic clock in s, replaceable in tests.
    """

    def __init__(
        self,
        cameras: Sequence[str],
        skeleton: SkeletonModel,
        stream: TextIO | None = None,
        clock: Callable[[], float] = time.monotonic,
    ):
        self._stream = sys.stdout if stream is None else stream
        self._clock = clock
        self._skeleton = skeleton
        self._terminal = self._stream.isatty()
        self._redrawn = RedrawnLines(self._stream)
        self._arrivals: dict[str, deque[float]] = {name: deque() for name in cameras}
        self._people_seen: dict[str, int] = dict.fromkeys(cameras, 0)
        self._dropped = 0
        self._poses: TrackedPoseSet | None = None
        self._pose_arrivals: deque[float] = deque()
        self._latencies: deque[float] = deque(maxlen=300)
        self._drawn_at = -1e9

    def saw_view(self, camera: str, people: int) -> None:
        """Record the arrival of one frame's detections with `people` persons."""
        self._arrivals.setdefault(camera, deque()).append(self._clock())
        self._people_seen[camera] = people
        self._redraw()

    def set_dropped(self, dropped: int) -> None:
        """Set the number of frames and messages dropped so far by all nodes."""
        self._dropped = dropped

    def saw_poses(self, poses: TrackedPoseSet, latency_ms: float | None = None) -> None:
        """Record the skeletons of an instant and their latency after capture in ms."""
        self._poses = poses
        self._pose_arrivals.append(self._clock())
        if latency_ms is not None:
            self._latencies.append(latency_ms)
        self._redraw()

    def close(self) -> None:
        """Draw the table a last time and leave it on the screen."""
        self._redraw(last=True)

    def lines(self, height: int = 1000) -> list[str]:
        """Return the table without colours, with its lists cut to fit `height` lines (at least 7)."""
        cameras, people = self._camera_rows(), self._people_rows()
        room = max(2, height - 5)
        people = _cut(people, max(room // 2, room - len(cameras)))
        return [
            f"{'camera':<14}{'frames/s':>10}{'people':>8}",
            *_cut(cameras, room - len(people)),
            "",
            f"{'person':<14}{'x m':>10}{'y m':>8}{'z m':>9}{'joints':>9}",
            *people,
            "",
            self._summary(),
        ]

    def _camera_rows(self) -> list[str]:
        rows = []
        for name, times in self._arrivals.items():
            rows.append(f"{name:<14}{self._rate(times):>10.1f}{self._people_seen.get(name, 0):>8}")
        return rows

    def _people_rows(self) -> list[str]:
        if self._poses is None or not len(self._poses.ids):
            return ["nobody"]
        rows = []
        for person in np.argsort(self._poses.ids):
            positions = self._poses.positions[person]
            x, y, z = positions[self._skeleton.head]
            there = int(np.isfinite(positions[:, 0]).sum())
            place = f"{'-':>10}{'-':>8}{'-':>9}" if np.isnan(x) else f"{x:>10.2f}{y:>8.2f}{z:>9.2f}"
            rows.append(f"{f'id {self._poses.ids[person]}':<14}{place}{f'{there}/{len(self._skeleton)}':>9}")
        return rows

    def _summary(self) -> str:
        text = f"skeletons {self._rate(self._pose_arrivals):.1f}/s"
        if self._latencies:
            p50, p99 = np.percentile(self._latencies, [50, 99])
            text += f", latency p50 {p50:.0f} ms, p99 {p99:.0f} ms"
        return f"{text}, {self._dropped} dropped" if self._dropped else text

    def _rate(self, times: deque[float]) -> float:
        now = self._clock()
        while times and times[0] < now - WINDOW_S:
            times.popleft()
        return len(times) / WINDOW_S

    def _redraw(self, last: bool = False) -> None:
        now = self._clock()
        if not last and now - self._drawn_at < (REDRAW_S if self._terminal else LINE_S):
            return
        self._drawn_at = now
        if self._terminal:
            rows = [self._colored(row) for row in self.lines(shutil.get_terminal_size().lines - 1)]
            self._redrawn.draw(rows)
        else:
            self._stream.write(self._plain_line() + "\n")
            self._stream.flush()

    def _plain_line(self) -> str:
        rates = ", ".join(f"{name} {self._rate(times):.1f}/s" for name, times in self._arrivals.items())
        people = [] if self._poses is None else sorted(int(identity) for identity in self._poses.ids)
        return f"{rates}; {self._summary()}; people {', '.join(map(str, people)) or 'none'}"

    def _colored(self, row: str) -> str:
        """Return the row in the overlay colour of its person, or unchanged if it is not a person row."""
        if not row.startswith("id "):
            return row
        red, green, blue = (round(255 * value) for value in rgb_of(int(row.split()[1])))
        return f"\x1b[38;2;{red};{green};{blue}m{row}\x1b[0m"


def _cut(rows: list[str], limit: int) -> list[str]:
    """Return at most `limit` rows; the last one states the number of hidden rows."""
    if len(rows) <= limit:
        return rows
    shown = max(0, limit - 1)
    return [*rows[:shown], f"... and {len(rows) - shown} more"]
