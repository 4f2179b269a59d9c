"""Part of the graph in replay: its stages process records in the order of their places.

The order of arrival does not matter. Records of sources, and records that follow them one to one, have the
place (time, owner, topic), see `graph.schedule`. The time is the timestamp on the common clock. Times of
another clock count from its first timestamp and begin where the common clock begins, unless the offset
between the clocks is known (`shift_ns`).

A host passes a record to its stages (`graph.pipeline`) as soon as no earlier one can arrive. Other records
from outside, such as latched facts, have no place. Stages process them on arrival.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from heapq import heappop, heappush
from typing import Any, NamedTuple

from panoptic_ros.graph.pipeline import Pipeline
from panoptic_ros.graph.schedule import DONE, END, Place
from panoptic_ros.graph.topics import TOPICS, number_of

Key = tuple[str, str]  # topic, owner
EARLY = 4  # records of a stream that get an early place after its start or a pause
PAUSE_NS = 500_000_000  # 0.5 s; a longer time between two records is a pause
JUMP_NS = 60_000_000_000  # 60 s; a longer step is a clock jump


class Lane(NamedTuple):
    """Topic of one camera or device.

    Args:
        topic, owner: Keys. A topic of the graph has the owner "".
        order: (number of the owner, number of the topic), the same in all processes of the graph.
        by_stamp: Whether timestamps give its records a place. Records of other lanes have no place.
        ahead_ns: See `graph.nodes.Port`.
        clock: Name of the clock of the timestamps.
        shift_ns: Added to timestamps to get times that all such lanes share. None: unknown.
    """

    topic: str
    owner: str
    order: tuple[int, int]
    by_stamp: bool
    ahead_ns: int = 0
    clock: str = ""
    shift_ns: int | None = None


class ClockOrigins(NamedTuple):
    """Time origins of the clocks.

    Args:
        shifts: By clock, ns: subtracted from its timestamps. The common clock has no entry.
        begin: Earliest time, ns.
    """

    shifts: Mapping[str, int]
    begin: int

    @classmethod
    def of(cls, firsts: Mapping[str, int], shifted: Sequence[int] = ()) -> ClockOrigins:
        """Return origins from the first timestamps of the clocks: all clocks begin with the common one ("").

        Args:
            firsts: First timestamp by clock, ns.
            shifted: First times of lanes with a known shift, ns. The earliest time of all is the beginning.
        """
        common = [firsts[""]] if "" in firsts else []
        begin = min([*common, *shifted], default=0)
        return cls({clock: first - begin for clock, first in firsts.items() if clock}, begin)


class CompanionStream:
    """Records that are passed on just before the records of another topic of the same owner.

    Depth maps, for example, come before their images. An image with timestamp t takes along all depth maps
    with timestamps before t plus the port's `ahead_ns`.
    """

    def __init__(self, lane: Lane):
        self.lane = lane
        self.wanted = False  # whether a record waits for further records of this stream
        self.ended = False
        self._records: deque[tuple[int, Any]] = deque()
        self._newest = -1

    def put(self, stamp_ns: int, record: Any) -> None:
        """Add an arrived record."""
        self._records.append((stamp_ns, record))
        self._newest = max(self._newest, stamp_ns)

    def end(self) -> None:
        """Mark the stream as completely arrived."""
        self.ended = True

    def covers(self, stamp_ns: int) -> bool:
        """Return whether everything that belongs to a record of this timestamp has arrived."""
        self.wanted = not self.ended and self._newest < stamp_ns + self.lane.ahead_ns
        return not self.wanted

    def take(self, stamp_ns: int) -> list[Any]:
        """Remove and return the records that belong to a record of this timestamp.

        Records that belong to no earlier record are included.
        """
        found = []
        while self._records and self._records[0][0] < stamp_ns + self.lane.ahead_ns:
            found.append(self._records.popleft()[1])
        return found


class StampedStream:
    """Records whose timestamps give their places.

    The first records of a stream that begins late or resumes after a pause get early places, right after its
    last place. So other streams do not wait for missing records. If its clock jumps, its time continues
    without the jump.
    """

    def __init__(self, lane: Lane):
        self.lane = lane
        self.bound: Place = ()  # lower bound of the places of records to come
        self._records: deque[tuple[int, Any]] = deque()
        self._last: int | None = None  # timestamp of the newest record with a place
        self._time = 0  # time of that place
        self._shift = 0  # from timestamps to times
        self._period = 1
        self._early = 0  # number of records that still get an early place
        self.ended = False

    @property
    def shown(self) -> bool:
        """Return whether any record has arrived."""
        return bool(self._records) or self._last is not None

    @property
    def first_stamp(self) -> int | None:
        """Return the timestamp of the first waiting record; None if no record waits."""
        return self._records[0][0] if self._records else None

    @property
    def empty(self) -> bool:
        """Return whether the stream has ended without a record."""
        return self.ended and not self._records and self._last is None

    def put(self, stamp_ns: int, record: Any) -> None:
        """Add an arrived record."""
        self._records.append((stamp_ns, record))

    def end(self) -> None:
        """Mark the stream as completely arrived."""
        self.ended = True

    def take(
        self, origins: ClockOrigins, beside: Sequence[CompanionStream] = ()
    ) -> list[tuple[Lane, Place, Any]]:
        """Remove and return the arrived records as (lane, place, record), each after its companions.

        Args:
            origins: Time origins of the clocks.
            beside: Companion streams of this stream. A record waits until all its companions have arrived.
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
        """Return the place of the newest record that has one."""
        return (self._time, *self.lane.order)

    def _time_of(self, stamp: int, origins: ClockOrigins) -> int:
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


class StreamGroup:
    """Merged streams: all of a host, or those of one camera or device."""

    def __init__(self, lanes: Sequence[Lane]):
        self.streams = {(lane.topic, lane.owner): StampedStream(lane) for lane in lanes if not lane.ahead_ns}
        self.beside = {(lane.topic, lane.owner): CompanionStream(lane) for lane in lanes if lane.ahead_ns}
        self._placed: list[tuple[Place, int, Lane, Any, bool]] = []  # a heap
        self._number = 0
        self._origins: ClockOrigins | None = None
        self._ends: dict[Key, bool] = {}  # ends that have arrived: whether they have a place

    def put(self, key: Key, stamp_ns: int, record: Any) -> None:
        """Add an arrived record."""
        (self.beside.get(key) or self.streams[key]).put(stamp_ns, record)

    def end(self, key: Key) -> None:
        """End a lane."""
        if key in self.beside:
            self.beside[key].end()
        else:
            self.streams[key].end()
            self._ends.setdefault(key, False)

    def waiting_for(self) -> tuple[bool, Place, tuple[int, int], Key] | None:
        """Return the lane whose next record or end is needed first; None if all lanes have ended."""
        waiting = [
            (stream.shown, stream.bound, stream.lane.order, key)
            for key, stream in self.streams.items()
            if not stream.ended
        ]
        waiting += [
            (False, (), stream.lane.order, key)
            for key, stream in self.beside.items()
            if not stream.ended and (stream.wanted or not waiting)
        ]
        return min(waiting) if waiting else None

    def bound(self, topics: frozenset[str] | None = None) -> Place:
        """Return a lower bound of the places to come on these topics (None: all)."""
        return min(
            (
                stream.bound
                for stream in self.streams.values()
                if topics is None or stream.lane.topic in topics
            ),
            default=(DONE,),
        )

    def place(self) -> None:
        """Give arrived records and ends their places, as far as these are determined."""
        origins = self._origins = self._origins or self._find_origins()
        if origins is not None:
            for stream in self.streams.values():
                beside = [other for other in self.beside.values() if other.lane.owner == stream.lane.owner]
                for lane, place, record in stream.take(origins, beside):
                    self._keep(lane, place, record)
        for key, placed in self._ends.items():
            stream = self.streams[key]
            if not placed and stream.bound == (DONE,):
                self._ends[key] = True
                self._keep(stream.lane, stream.last_place, None, is_end=True)

    def take(self, bound: Place) -> tuple[Place, Lane, Any, bool] | None:
        """Remove and return the next record whose place is not after `bound`.

        Returns:
            place, lane, record, and whether it is an end.
        """
        if not self._placed or self._placed[0][0] > bound:
            return None
        place, _, lane, record, is_end = heappop(self._placed)
        return place, lane, record, is_end

    def _keep(self, lane: Lane, place: Place, record: Any, is_end: bool = False) -> None:
        self._number += 1
        heappush(self._placed, (place, self._number, lane, record, is_end))

    def _find_origins(self) -> ClockOrigins | None:
        """Return the time origins of all clocks; None if a lane has no record yet."""
        if any(stream.first_stamp is None and not stream.empty for stream in self.streams.values()):
            return None
        firsts: dict[str, int] = {}
        shifted: list[int] = []
        for stream in self.streams.values():
            first, clock, shift = stream.first_stamp, stream.lane.clock, stream.lane.shift_ns
            if first is not None and shift is not None:
                shifted.append(first + shift)
            elif first is not None:
                firsts[clock] = min(first, firsts.get(clock, first))
        return ClockOrigins.of(firsts, shifted)


class Host:
    """Stages, and the order in which they process records from outside.

    Args:
        pipeline: The stages. It reports the ends of cameras and devices; the host reports those of whole
            topics.
        lanes: All lanes from outside.
        on_end: Called with a topic when the stages give no more records on it.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        lanes: Sequence[Lane],
        on_end: Callable[[str], None] = lambda topic: None,
    ):
        self._pipeline, self._on_end = pipeline, on_end
        wiring = pipeline.wiring
        self.keys = {(lane.topic, lane.owner) for lane in lanes}
        merged = [lane for lane in lanes if lane.by_stamp]
        self._merged = {(lane.topic, lane.owner) for lane in merged}
        optional = {port.topic for port in wiring.inputs if port.optional}
        self._open_at_once = {key for key in self.keys - self._merged if key[0] not in optional}
        self._apart = all(spec.apart for spec in wiring.specs)
        owners = dict.fromkeys(lane.owner if self._apart else "" for lane in merged)
        self._groups = {
            owner: StreamGroup([lane for lane in merged if not self._apart or lane.owner == owner])
            for owner in owners
        }
        self._reaching = [
            frozenset(lane.topic for lane in merged if stage in wiring.reached(lane.topic))
            for stage in range(len(wiring.specs))
        ]
        self._flushed = 0
        self.over = False

    # ------------------------------------------------------------------ input

    def put(self, topic: str, owner: str, stamp_ns: int, record: Any) -> None:
        """Add an arrived record; None stands for an unusable one."""
        key = (topic, owner)
        if key not in self._merged:
            if record is not None:
                self._pipeline.push(topic, record)
            return
        self._group(owner).put(key, stamp_ns, record)

    def end(self, topic: str, owner: str) -> None:
        """Mark a lane as completely arrived."""
        if (topic, owner) not in self._merged:
            self._open_at_once.discard((topic, owner))
            self._pipeline.end(topic, owner)
        else:
            self._group(owner).end((topic, owner))

    def waiting_for(self) -> Key | None:
        """Return the lane whose next record or end the stages need; None if all lanes have ended."""
        waiting = [found for group in self._groups.values() if (found := group.waiting_for()) is not None]
        return min(waiting)[3] if waiting else None

    def advance(self) -> None:
        """Process all records whose turn has come, and flush the stages after the last lane has ended."""
        if self.over:
            return
        for group in self._groups.values():
            group.place()
            limit = group.bound() if self._apart else (DONE,)
            while (item := group.take(limit)) is not None:
                self._add(*item)
                if self._apart:
                    self._pipeline.run()
            if not self._apart:
                self._pipeline.run(self._bounds)
        self._finish_stages()

    # ------------------------------------------------------------------ helpers

    def _group(self, owner: str) -> StreamGroup:
        return self._groups[owner if self._apart else ""]

    def _add(self, place: Place, lane: Lane, record: Any, is_end: bool) -> None:
        if is_end:
            self._pipeline.add_end(lane.topic, lane.owner, place)
        elif record is not None:
            self._pipeline.schedule.add(lane.topic, record, place)

    def _bounds(self, stage: int) -> Place:
        """Return a lower bound of the places that a stage may still get from outside."""
        topics = self._reaching[stage]
        return min((group.bound(topics) for group in self._groups.values()), default=(DONE,))

    def _finish_stages(self) -> None:
        """Flush the stages that get no more records, in order."""
        schedule, wiring = self._pipeline.schedule, self._pipeline.wiring
        for stage, spec in enumerate(wiring.specs):
            if not self._is_open(stage) and schedule.is_over(stage, self._bounds):
                self._pipeline.flush_stage(stage)
                self._pipeline.run(self._bounds)
                self._flushed += 1
                for topic in spec.outputs:
                    self._on_end(topic)
        self.over = self._flushed == len(wiring.specs)

    def _is_open(self, stage: int) -> bool:
        """Return whether a record without a place may still reach a stage."""
        return any(stage in self._pipeline.wiring.reached(topic) for topic, _ in self._open_at_once)


def lanes_of(
    topics: Sequence[str],
    owners: Callable[[str], Sequence[str]],
    pipeline: Pipeline,
    clocks: Callable[[str], str] = lambda owner: "",
    shifts: Mapping[str, int] = {},
) -> list[Lane]:
    """Return the lanes of topics from outside.

    Args:
        topics: Keys.
        owners: Returns the cameras or devices that give a topic, in the order of the rig; ("",) for topics of
            the graph.
        pipeline: The stages that take the topics.
        clocks: Returns the name of the clock of an owner's timestamps. IMUs are roughly on the common clock.
        shifts: ns, by owner, or by topic if it differs from that of its owner: added to timestamps, where it
            is known. See `Lane`.
    """
    ports = {port.topic: port for port in pipeline.wiring.inputs}
    return [
        Lane(
            topic,
            owner,
            (order, number_of(topic)),
            TOPICS[topic].by_stamp,
            ports[topic].ahead_ns,
            "" if TOPICS[topic].scope == "imu" else clocks(owner),
            shifts.get(TOPICS[topic].of(owner), shifts.get(owner)),
        )
        for topic in topics
        for order, owner in enumerate(owners(topic))
    ]
