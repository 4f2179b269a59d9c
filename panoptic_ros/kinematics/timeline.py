"""Instants of a fixed rate, and the time at which the data of an instant are complete.

`LagBuffer` holds the instants within the lag, with the bodies that were solved at them so far.

`InstantSelection` selects the instants that a late stage skips to catch up. If data have waited for n
sixtieths of a second, one instant of n is solved, and the time steps are n times as long. This is stable: the
fewer instants a machine can solve, the longer its data wait, and the fewer instants are selected.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

from panoptic_ros.domain.subjects import BodyState
from panoptic_ros.kinematics.people.seen_people import NEAR_NS

# ns; a timestamp this far from the newest one is wrong, unless timestamps of other sources follow it
JUMP_NS = 2_000_000_000
# minimum speed of the timestamps of delayed samples, relative to the timestamps of the other sources
CATCHES_UP = 1.5
# number of distant timestamps that are accepted, if they are from most of the cameras, or, without cameras,
# from most of the devices
BELIEVED = 5
WAIT_NS = 500_000_000  # waiting time for cameras, before instants begin with the first sample of an IMU
STOPPED_NS = 500_000_000  # ns of silence after which instants no longer wait for a source
USUAL_PERIOD_NS = 40_000_000  # default period of a camera with fewer than two timestamps
LONGEST_PERIOD_NS = 100_000_000
# minimum waiting time: views of faster cameras still pass through association and tracking
LEAST_PATIENCE_NS = 33_000_000
# ns, waiting time of samples per period of a time step. Samples of a node that keeps up with four people wait
# for less than twice this time.
PACE_NS = 1_000_000_000 // 60
LONGEST_S = 0.1  # maximum interval between solved instants


class _StampGap(NamedTuple):
    """Timestamps of one source that are too far from those of the others.

    Attributes:
        number: Number of them.
        first, newest: The first and the newest one, ns.
        others: Newest timestamp of the others at the time of the first, ns.
    """

    number: int
    first: int
    others: int
    newest: int


class InstantSchedule:
    """Schedule of the instants.

    Sources are cameras and devices. Cameras are given by index, where negative means skeletons; devices are
    given by name.

    Args:
        rate_hz: Rate of the instants.
    """

    def __init__(self, rate_hz: float):
        self._rate_hz = rate_hz
        self._origin: int | None = None
        self._count = 0  # number of instants since the origin
        self._before = 0  # number of instants before the origin
        self._first_imu: int | None = None
        self._last: dict[int | str, int] = {}
        self._awaited: int | str | None = None  # the source for which the last call waited
        self._periods: dict[int | str, int] = {}
        self._slowest = USUAL_PERIOD_NS  # longest period of a camera
        # gap since the last timestamp of a source that was not too far off, by source
        self._ahead: dict[int | str, _StampGap] = {}
        self._others_go_on = False  # whether other sources continued since the first of these gaps
        self.newest_ns = -1

    @property
    def index(self) -> int:
        """Return the index of the next instant."""
        return self._before + self._count

    @property
    def next_ns(self) -> int | None:
        """Return the next instant, ns; None before the first."""
        if self._origin is None:
            return None
        return self._origin + round(self._count * 1e9 / self._rate_hz)

    @property
    def patience_ns(self) -> int:
        """Return one period, ns, of the slowest camera: the time for which an instant waits for its data."""
        return self._slowest

    def came(self, source: int | str, stamp_ns: int) -> str:
        """Record a sample, and return how its timestamp relates to those of the other sources.

        Returns:
            "" if the timestamp belongs to the time of the others. "jump" if time continues from it. "odd" or
            "early" if the sample is to be dropped. It is "odd" where the others continue in their time, and
            "early" where they may still follow.
        """
        if self.newest_ns >= 0 and abs(stamp_ns - self.newest_ns) > JUMP_NS:
            self._others_go_on &= bool(self._ahead)
            before = self._ahead.get(source, _StampGap(0, stamp_ns, self.newest_ns, stamp_ns))
            self._ahead[source] = before._replace(number=before.number + 1, newest=stamp_ns)
            if not self._goes_on_elsewhere():
                return "odd" if self._others_go_on else "early"
            self.restart()
            self._took(source, stamp_ns)
            return "jump"
        self._ahead.pop(source, None)
        self._others_go_on = True
        self._took(source, stamp_ns)
        return ""

    def _goes_on_elsewhere(self) -> bool:
        """Return whether most of the relevant sources now have another time.

        Cameras are relevant, or devices if there are no cameras. A single device may have a wrong clock.
        """
        alive = {name for name, last in self._last.items() if last > self.newest_ns - STOPPED_NS}
        sources = alive | self._ahead.keys()
        cameras = {name for name in sources if isinstance(name, int)}
        others_go_on = bool(alive - self._ahead.keys())
        ahead = {
            name
            for name in self._ahead.keys() & (cameras or sources)
            if not (others_go_on and self._may_be_late(self._ahead[name]))
        }
        told = sum(self._ahead[name].number for name in ahead)
        return told >= BELIEVED and 2 * len(ahead) > len(cameras or sources)

    def _may_be_late(self, apart: _StampGap) -> bool:
        """Return whether timestamps from the past may belong to delayed samples.

        After the start of a busy machine, for example, samples wait and then come faster than time passes. A
        few samples do not show this, so they are treated as delayed.
        """
        if apart.newest > self.newest_ns:
            return False
        passed = self.newest_ns - apart.others
        return apart.number < BELIEVED or apart.newest - apart.first > CATCHES_UP * passed

    def _took(self, source: int | str, stamp_ns: int) -> None:
        last = self._last.get(source)
        if last is not None and stamp_ns <= last:
            return
        if last is not None:
            period = min(stamp_ns - last, LONGEST_PERIOD_NS)
            before = self._periods.get(source, period)
            self._periods[source] = before + (period - before) // 8
            if isinstance(source, int):
                alive = [self._periods[name] for name in self._cameras() if name in self._periods]
                self._slowest = max([self._periods[source], *alive])
        self._last[source] = stamp_ns
        self.newest_ns = max(self.newest_ns, stamp_ns)
        if self._origin is None:
            if isinstance(source, int):
                self._origin = stamp_ns
            elif self._first_imu is None:
                self._first_imu = stamp_ns
            elif stamp_ns - self._first_imu > WAIT_NS:
                self._origin = self._first_imu

    def has_cameras(self) -> bool:
        """Return whether cameras deliver samples."""
        return any(name >= 0 for name in self._cameras())

    def _cameras(self) -> list[int]:
        """Return the cameras that are not silent."""
        since = self.newest_ns - STOPPED_NS
        return [name for name, last in self._last.items() if isinstance(name, int) and last > since]

    def restart(self) -> None:
        """Forget the timestamps of all sources. The index of instants continues."""
        self._origin = self._first_imu = None
        self._last, self._periods, self._slowest, self._ahead = {}, {}, USUAL_PERIOD_NS, {}
        self._awaited = None
        self._others_go_on = False
        self._before, self._count, self.newest_ns = self.index, 0, -1

    def due(self, at_end: bool = False) -> int | None:
        """Return the next instant if it is due, else None, and move on to the one after it.

        An instant is due if its data are complete or the waiting time is over.

        Args:
            at_end: True if no more data come. All instants up to the newest sample are then due.
        """
        stamp = self.next_ns
        if stamp is None or self.newest_ns < stamp - NEAR_NS:
            return None
        patience = max(self.patience_ns, LEAST_PATIENCE_NS)
        if self.newest_ns < stamp + patience and not at_end and self._waits(stamp):
            return None
        self._count += 1
        return stamp

    def _waits(self, stamp_ns: int) -> bool:
        """Return whether a source that is not silent has not yet reached an instant."""
        alive, begin = self.newest_ns - STOPPED_NS, stamp_ns - NEAR_NS
        if self._awaited is not None and alive < self._last.get(self._awaited, alive) < begin:
            return True  # fast path, which most of the many samples take
        late = (name for name, last in self._last.items() if alive < last < begin)
        self._awaited = next(late, None)
        return self._awaited is not None


class LagBuffer:
    """Instants within the lag, the oldest first, with their bodies."""

    def __init__(self) -> None:
        self._instants: deque[tuple[int, int, dict[int, BodyState]]] = deque()

    def __len__(self) -> int:
        return len(self._instants)

    def add(self, index: int, stamp_ns: int) -> None:
        """Append an instant."""
        self._instants.append((index, stamp_ns, {}))

    def keep(self, states: Sequence[BodyState]) -> None:
        """Keep bodies until their instant is taken."""
        if states:
            places = {stamp: found for _, stamp, found in self._instants}
            for state in states:
                if state.stamp_ns in places:
                    places[state.stamp_ns][state.id] = state

    def holds(self, number: int) -> bool:
        """Return whether an instant has a body of this id."""
        return any(number in kept for _, _, kept in self._instants)

    def is_due(self, index: int) -> bool:
        """Return whether the oldest instant has this index or a lower one."""
        return bool(self._instants) and self._instants[0][0] <= index

    def take(self) -> tuple[int, int, dict[int, BodyState]]:
        """Remove the oldest instant, and return its index, timestamp and bodies."""
        return self._instants.popleft()


class InstantSelection:
    """Selection of the instants that are solved.

    Args:
        rate_hz: Rate of the instants.
    """

    def __init__(self, rate_hz: float):
        self._most = max(1, int(LONGEST_S * rate_hz + 1e-9))
        self.waited_ns = 0  # waiting time of the current data before the stage took them
        self._left_out = 0  # number of instants skipped since the last solved one

    def step(self) -> int:
        """Record a due instant; return the periods since the last solved one, or 0 to skip it."""
        wanted = min(max(1, self.waited_ns // PACE_NS), self._most)
        if self._left_out + 1 < wanted:
            self._left_out += 1
            return 0
        stride, self._left_out = self._left_out + 1, 0
        return stride
