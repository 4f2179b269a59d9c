"""Lanes whose records are merged by their places."""

from __future__ import annotations

from collections.abc import Sequence
from heapq import heappop, heappush
from typing import Any

from panoptic_ros.graph.lanes import BesideStream, Lane, MarkedStream, Origins, StampedStream
from panoptic_ros.graph.schedule import DONE, Place

Key = tuple[str, str]  # topic, owner


class Group:
    """Streams that are merged: all of a host, or those of one camera or device."""

    def __init__(self, lanes: Sequence[Lane]):
        stamped = [lane for lane in lanes if lane.by_stamp]
        self.stamped = {
            (lane.topic, lane.owner): StampedStream(lane) for lane in stamped if not lane.ahead_ns
        }
        self.beside = {(lane.topic, lane.owner): BesideStream(lane) for lane in stamped if lane.ahead_ns}
        self.marked = {(lane.topic, lane.owner): MarkedStream(lane) for lane in lanes if not lane.by_stamp}
        self._placed: list[tuple[Place, int, Lane, Any, bool]] = []  # a heap
        self._number = 0
        self._origins: Origins | None = None
        self._ends: dict[Key, bool] = {}  # ends that have come: whether they were placed

    @property
    def streams(self) -> dict[Key, StampedStream | MarkedStream]:
        """Those that have an order of their own."""
        return {**self.stamped, **self.marked}

    def put(self, key: Key, stamp_ns: int, record: Any) -> None:
        """A record has arrived."""
        if key in self.marked:
            self.marked[key].put(record)
        else:
            (self.beside.get(key) or self.stamped[key]).put(stamp_ns, record)

    def end(self, key: Key) -> None:
        """No more will come on a lane."""
        if key in self.beside:
            self.beside[key].end()
        else:
            self.streams[key].end()
            self._ends.setdefault(key, False)

    def waiting_for(self) -> tuple[bool, Place, tuple[int, int], Key] | None:
        """The lane on which something must come, or end, first; None: all have ended."""
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
        """What is still to come on these topics (None: all) is not before this."""
        return min(
            (
                stream.bound
                for stream in self.streams.values()
                if topics is None or stream.lane.topic in topics
            ),
            default=(DONE,),
        )

    def place(self) -> None:
        """Give all that has come its place, as far as that is known."""
        origins = self._origins = self._origins or self._find_origins()
        if origins is not None:
            for stream in self.stamped.values():
                beside = [other for other in self.beside.values() if other.lane.owner == stream.lane.owner]
                for lane, place, record in stream.take(origins, beside):
                    self._keep(lane, place, record)
        for marked in self.marked.values():
            for place, record in marked.take():
                self._keep(marked.lane, place, record)
        for key, placed in self._ends.items():
            if not placed and self._all_placed(key):
                self._ends[key] = True
                if key in self.stamped:
                    self._keep(self.stamped[key].lane, self.stamped[key].last_place, None, is_end=True)

    def take(self, bound: Place) -> tuple[Place, Lane, Any, bool] | None:
        """The next record that is not after this place: place, lane, record, whether it is an end."""
        if not self._placed or self._placed[0][0] > bound:
            return None
        place, _, lane, record, is_end = heappop(self._placed)
        return place, lane, record, is_end

    def _all_placed(self, key: Key) -> bool:
        return self.streams[key].bound == (DONE,)

    def _keep(self, lane: Lane, place: Place, record: Any, is_end: bool = False) -> None:
        self._number += 1
        heappush(self._placed, (place, self._number, lane, record, is_end))

    def _find_origins(self) -> Origins | None:
        """Where the times of all clocks begin; None: a lane has not shown it yet."""
        if any(stream.first_stamp is None and not stream.empty for stream in self.stamped.values()):
            return None
        firsts: dict[str, int] = {}
        shifted: list[int] = []
        for stream in self.stamped.values():
            first, clock, shift = stream.first_stamp, stream.lane.clock, stream.lane.shift_ns
            if first is not None and shift is not None:
                shifted.append(first + shift)
            elif first is not None:
                firsts[clock] = min(first, firsts.get(clock, first))
        return Origins.of(firsts, shifted)
