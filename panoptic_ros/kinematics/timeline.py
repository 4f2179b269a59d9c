"""Instants of a fixed rate, and when all that belongs to one has come.

`HeldInstants` are those that the lag holds back, with the bodies that were solved at them so far. `Pace`
says which instants a late stage leaves out, so that it catches up. With data that have waited for n
sixtieths of a second, one instant of n is solved, and the steps between are so much longer. That settles:
the fewer instants a machine can solve, the longer its data wait, and the fewer are solved.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

from panoptic_ros.domain.subjects import BodyState
from panoptic_ros.kinematics.people.seen_people import NEAR_NS

JUMP_NS = 2_000_000_000  # a stamp that is so far ahead is another's, unless others follow
CATCHES_UP = 1.5  # times as fast as others: what comes is late
BELIEVED = 5  # of them, of most of the cameras; where there is none, of most of the devices
WAIT_NS = 500_000_000  # for cameras, before instants begin with the first sample of an IMU
STOPPED_NS = 500_000_000  # nobody waits for a source that has given nothing for so long
USUAL_PERIOD_NS = 40_000_000  # of a camera of which no two stamps are known
LONGEST_PERIOD_NS = 100_000_000
LEAST_PATIENCE_NS = 33_000_000  # views of quicker cameras still go through association and tracking first
PACE_NS = 1_000_000_000 // 60  # twice of it is more than a node waits that solves for four people in time
LONGEST_S = 0.1  # from one instant that is solved to the next


class _Apart(NamedTuple):
    """Stamps too far from those of others: how many, the first one, the newest of others then, the newest."""

    number: int
    first: int
    others: int
    newest: int


class Timeline:
    """When instants are due. Sources are cameras (their indices; less than 0: skeletons) and devices (their
    names).

    Args:
        rate_hz: of the instants.
    """

    def __init__(self, rate_hz: float):
        self._rate_hz = rate_hz
        self._origin: int | None = None
        self._count = 0  # instants given since the origin
        self._before = 0  # and before that
        self._first_imu: int | None = None
        self._last: dict[int | str, int] = {}
        self._awaited: int | str | None = None  # who was waited for when it was asked last
        self._periods: dict[int | str, int] = {}
        self._slowest = USUAL_PERIOD_NS  # of the cameras' periods
        self._ahead: dict[int | str, _Apart] = {}  # by source, since its last stamp that was not too far off
        self._others_go_on = False  # since the first of these
        self.newest_ns = -1

    @property
    def index(self) -> int:
        """Of the next instant."""
        return self._before + self._count

    @property
    def next_ns(self) -> int | None:
        """The next instant; None before the first."""
        if self._origin is None:
            return None
        return self._origin + round(self._count * 1e9 / self._rate_hz)

    @property
    def patience_ns(self) -> int:
        """One period of the slowest camera: for so long instants wait for what was measured at them."""
        return self._slowest

    def came(self, source: int | str, stamp_ns: int) -> str:
        """A sample has come: "" if it belongs to the time of the others, "jump" if time goes on from it. It
        is to be left out if it is "odd", as others go on in their time, or "early", as they may follow it."""
        if self.newest_ns >= 0 and abs(stamp_ns - self.newest_ns) > JUMP_NS:
            self._others_go_on &= bool(self._ahead)
            before = self._ahead.get(source, _Apart(0, stamp_ns, self.newest_ns, stamp_ns))
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
        """Whether most of those whose clock counts, of late, tell another time: a device alone has a clock
        that is wrong."""
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

    def _may_be_late(self, apart: _Apart) -> bool:
        """Whether stamps from long ago are those of samples that waited somewhere, as after the start of a
        busy machine: they come faster than time goes by. A few do not tell."""
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
        """Whether cameras give samples."""
        return any(name >= 0 for name in self._cameras())

    def _cameras(self) -> list[int]:
        """Those that are alive."""
        since = self.newest_ns - STOPPED_NS
        return [name for name, last in self._last.items() if isinstance(name, int) and last > since]

    def restart(self) -> None:
        """Forget when sources came; instants count on."""
        self._origin = self._first_imu = None
        self._last, self._periods, self._slowest, self._ahead = {}, {}, USUAL_PERIOD_NS, {}
        self._awaited = None
        self._others_go_on = False
        self._before, self._count, self.newest_ns = self.index, 0, -1

    def due(self, at_end: bool = False) -> int | None:
        """The next instant if all that belongs to it has come, or nobody waits any longer; it is taken then.

        Args:
            at_end: nothing more comes: all instants up to the newest sample.
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
        """Whether somebody who is alive has not come to an instant."""
        alive, begin = self.newest_ns - STOPPED_NS, stamp_ns - NEAR_NS
        if self._awaited is not None and alive < self._last.get(self._awaited, alive) < begin:
            return True  # as with most of the samples, of which there are many
        late = (name for name, last in self._last.items() if alive < last < begin)
        self._awaited = next(late, None)
        return self._awaited is not None


class HeldInstants:
    """The oldest first."""

    def __init__(self) -> None:
        self._instants: deque[tuple[int, int, dict[int, BodyState]]] = deque()

    def __len__(self) -> int:
        return len(self._instants)

    def add(self, index: int, stamp_ns: int) -> None:
        """One more."""
        self._instants.append((index, stamp_ns, {}))

    def keep(self, states: Sequence[BodyState]) -> None:
        """Keep bodies until their instant is given."""
        if states:
            places = {stamp: found for _, stamp, found in self._instants}
            for state in states:
                if state.stamp_ns in places:
                    places[state.stamp_ns][state.id] = state

    def holds(self, number: int) -> bool:
        """Whether a body of this id is among them."""
        return any(number in kept for _, _, kept in self._instants)

    def is_due(self, index: int) -> bool:
        """Whether the oldest is one up to this one."""
        return bool(self._instants) and self._instants[0][0] <= index

    def take(self) -> tuple[int, int, dict[int, BodyState]]:
        """Index, stamp and bodies of the oldest."""
        return self._instants.popleft()


class Pace:
    """Decides, instant by instant.

    Args:
        rate_hz: of the instants.
    """

    def __init__(self, rate_hz: float):
        self._most = max(1, int(LONGEST_S * rate_hz + 1e-9))
        self.waited_ns = 0  # by what is at hand, before the stage came to it
        self._left_out = 0  # instants since the last one that was solved

    def step(self) -> int:
        """Another instant is due: periods since the last one that was solved, or 0 if it is left out."""
        wanted = min(max(1, self.waited_ns // PACE_NS), self._most)
        if self._left_out + 1 < wanted:
            self._left_out += 1
            return 0
        stride, self._left_out = self._left_out + 1, 0
        return stride
