"""What comes from outside on one topic of one camera or device, and the places of it (see `graph.schedule`).

Records of sources, and those that follow them one by one, have the place (time, owner, topic). The time is
their stamp; of a clock of its own, it is counted from the first stamp and begins where the common clock
does, unless it is known by how much the clocks differ (`shift_ns`). The places of other records are told by
markers: "the newest record is at p" and "all that is still to come is not before p".
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from panoptic_ros.graph.schedule import DONE, END, Place

EARLY = 4  # records of a stream that are shown early after its start or a pause
PAUSE_NS = 500_000_000  # a longer time between two records is a pause
JUMP_NS = 60_000_000_000  # a still longer one is a clock that jumped


class Lane(NamedTuple):
    """One topic of one camera or device.

    Args:
        topic, owner: keys. A topic of the graph has the owner "".
        order: (number of the owner, number of the topic), the same everywhere in a graph.
        by_stamp: places come from stamps, otherwise from markers.
        ahead_ns: see `graph.nodes.Port`.
        clock: whose clock the stamps are on.
        shift_ns: what is added to stamps for a time that all such lanes share; None: not known.
    """

    topic: str
    owner: str
    order: tuple[int, int]
    by_stamp: bool
    ahead_ns: int = 0
    clock: str = ""
    shift_ns: int | None = None


class Origins(NamedTuple):
    """Where times begin.

    Args:
        shifts: what is taken from the stamps of a clock; of the common one nothing.
        begin: the earliest time.
    """

    shifts: Mapping[str, int]
    begin: int

    @classmethod
    def of(cls, firsts: Mapping[str, int], shifted: Sequence[int] = ()) -> Origins:
        """Origins by the first stamps of the clocks: all begin with the common one ("").

        Args:
            shifted: first times of lanes whose clocks are known; the first of all is the beginning.
        """
        common = [firsts[""]] if "" in firsts else []
        begin = min([*common, *shifted], default=0)
        return cls({clock: first - begin for clock, first in firsts.items() if clock}, begin)


class MarkedStream:
    """Records whose places are told by markers. Markers may come before the records that they speak of."""

    def __init__(self, lane: Lane):
        self.lane = lane
        self.bound: Place = ()  # what is still to come is not before this
        self._records: deque[Any] = deque()
        self._markers: deque[tuple[Place, int]] = deque()
        self._arrived = self._placed = 0
        self.ended = False

    @property
    def shown(self) -> bool:
        """Whether anything has come."""
        return self._arrived > 0

    def put(self, record: Any) -> None:
        """A record has arrived."""
        self._records.append(record)
        self._arrived += 1

    def mark(self, place: Place, count: int) -> None:
        """A marker has arrived: `count` records were sent before it."""
        self._markers.append((place, count))

    def end(self) -> None:
        """All that was sent has arrived; the last marker tells that nothing follows."""
        self.ended = True

    def take(self) -> list[tuple[Place, Any]]:
        """The records that have got their places."""
        found: list[tuple[Place, Any]] = []
        while self._markers and self._markers[0][1] <= self._arrived:
            place, count = self._markers.popleft()
            if count > self._placed:
                found.append((place, self._records.popleft()))
                self._placed += 1
                place = (*place, DONE)
            self.bound = max(self.bound, place)
        return found


class BesideStream:
    """Records that are handed over just before those of another topic of their owner, by their stamps.

    Such as depth maps before the images that they belong to: with the image of stamp t come those before t
    plus the time by which the port is ahead.
    """

    def __init__(self, lane: Lane):
        self.lane = lane
        self.wanted = False  # whether a record waits for what is to come
        self.ended = False
        self._records: deque[tuple[int, Any]] = deque()
        self._newest = -1

    def put(self, stamp_ns: int, record: Any) -> None:
        """A record has arrived."""
        self._records.append((stamp_ns, record))
        self._newest = max(self._newest, stamp_ns)

    def end(self) -> None:
        """All that was sent has arrived."""
        self.ended = True

    def covers(self, stamp_ns: int) -> bool:
        """Whether all that belongs to a record of this stamp has come."""
        self.wanted = not self.ended and self._newest < stamp_ns + self.lane.ahead_ns
        return not self.wanted

    def take(self, stamp_ns: int) -> list[Any]:
        """What belongs to a record of this stamp, or to none before it."""
        found = []
        while self._records and self._records[0][0] < stamp_ns + self.lane.ahead_ns:
            found.append(self._records.popleft()[1])
        return found


class StampedStream:
    """Records whose stamps tell their places.

    A stream that begins later than others, or pauses, shows its next records early, at the place where it was
    silent. So nobody waits for what does not come. Where its clock jumps, its time goes on.
    """

    def __init__(self, lane: Lane):
        self.lane = lane
        self.bound: Place = ()  # what is still to come is not before this
        self._records: deque[tuple[int, Any]] = deque()
        self._last: int | None = None  # stamp of the newest record with a place
        self._time = 0  # of that place
        self._shift = 0  # from stamps to times
        self._period = 1
        self._early = 0  # records that are still shown early
        self.ended = False

    @property
    def shown(self) -> bool:
        """Whether anything has come."""
        return bool(self._records) or self._last is not None

    @property
    def first_stamp(self) -> int | None:
        """Stamp of the first record; None: none has come."""
        return self._records[0][0] if self._records else None

    @property
    def empty(self) -> bool:
        """Whether it has ended without a record."""
        return self.ended and not self._records and self._last is None

    def put(self, stamp_ns: int, record: Any) -> None:
        """A record has arrived."""
        self._records.append((stamp_ns, record))

    def end(self) -> None:
        """All that was sent has arrived."""
        self.ended = True

    def take(self, origins: Origins, beside: Sequence[BesideStream] = ()) -> list[tuple[Lane, Place, Any]]:
        """The records that have come, with their lanes and places, each behind those that belong beside it.

        Args:
            beside: what waits for records of this stream; a record waits until all of it has come.
        """
        found: list[tuple[Lane, Place, Any]] = []
        while self._records and all(stream.covers(self._records[0][0]) for stream in beside):
            stamp, record = self._records.popleft()
            time = self._time_of(stamp, origins)
            for stream in beside:
                owner, topic = stream.lane.order
                found += [(stream.lane, (time, owner, -topic), other) for other in stream.take(stamp)]
            found.append((self.lane, (time, *self.lane.order), record))
            self.bound = (time, *self.lane.order, END)
        if self.ended and not self._records:
            self.bound = (DONE,)
        return found

    @property
    def last_place(self) -> Place:
        """Of the newest record that has a place."""
        return (self._time, *self.lane.order)

    def _time_of(self, stamp: int, origins: Origins) -> int:
        if self._last is None:
            known = self.lane.shift_ns
            self._shift = -origins.shifts.get(self.lane.clock, 0) if known is None else known
            self._early = EARLY if stamp + self._shift - origins.begin > PAUSE_NS else 0
            self._time = origins.begin - 1
        else:
            step = stamp - self._last
            if not 0 < step <= JUMP_NS:
                self._shift -= step - self._period
            elif step > PAUSE_NS:
                self._early = EARLY
            else:
                self._period = step
        self._last = stamp
        soon = self._time + 1
        if self._early:
            self._early -= 1
            self._time = soon
        else:
            self._time = max(soon, stamp + self._shift)
        return self._time
