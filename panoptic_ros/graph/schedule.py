"""Order in which stages process records: the same in one process and in the standard graph.

Every record has a place, a tuple of integers that is compared from the left. Records of sources get places
from their timestamps (`graph.host`). A stage of rank s processes a record of place p at the turn p + (s,).
Its n-th output for that record has the place p + (s, n). A stage processes records in the order of their
turns. So everything that follows from a record in earlier stages is done before a later stage processes the
record. The places of a stage's outputs never decrease. A port marked `first` gets records before all other
ports. A record that follows a source record one to one has the same place, except for the topic, which is the
last element of such places (`graph.host`).

A stage that gets feedback from a later stage is called a head. It processes one record at a time. It takes
the next record when everything that follows from the current one is done, including the feedback. Its outputs
for the feedback get the next places after its earlier outputs.

Places are the logical times of a conservative simulation in the sense of Chandy and Misra (1979), nested as
in Naiad (Murray et al. 2013).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection
from dataclasses import dataclass
from heapq import heappop, heappush
from typing import Any, NamedTuple

from panoptic_ros.graph.topics import TOPICS, number_of
from panoptic_ros.graph.wiring import TopicReader, Wiring

Place = tuple[int, ...]
DONE = 2**63 - 1  # p + (DONE,) is after everything that follows from p
END = DONE - 1  # p + (END,): end of a stream whose last record had the place p
FLUSH = DONE - 1  # time of the outputs of a flush
FIRST = -(2**31)  # added to the rank of a stage for a port marked `first`
Bounds = Callable[[int], Place]  # stage -> lower bound of the places that may still come from outside


class StageTurn(NamedTuple):
    """Turn of a stage to process a record.

    Args:
        time: Place of the record, with the rank of the stage.
        stage: Number of the stage.
        record: The record.
        beside: Whether it comes from an optional port, so the main output does not follow from it.
    """

    time: Place
    stage: int
    record: Any
    beside: bool = False


@dataclass
class _OpenRecord:
    """Current record of a head.

    Args:
        turn: Its turn.
        given: Number of outputs for it.
        last: Place of the newest output, if its timestamp gives one.
    """

    turn: StageTurn
    given: int = 0
    last: Place = ()

    @property
    def floor(self) -> Place:
        """Return a place after everything that follows from the outputs so far."""
        return (*self.last, DONE) if self.last else (*self.turn.time, self.given + 1)


class StageSchedule:
    """Queues of the records that wait for the stages of one process."""

    def __init__(self, wiring: Wiring):
        self._wiring = wiring
        self._waiting: list[list[tuple[Place, int, Any, bool]]] = [[] for _ in wiring.specs]  # heaps by turn
        self._back: list[deque[Any]] = [deque() for _ in wiring.specs]
        self._open: list[_OpenRecord] = []  # current records of heads, the innermost last
        self._given: tuple[Place, int] = (
            (),
            0,
        )  # current turn of a stage that is not a head, and number of outputs for it
        self._number = 0
        self._closed: set[int] = set()

    def add(self, topic: str, record: Any, place: Place, giver: int | None = None) -> None:
        """Add a record for all stages that take its topic.

        Args:
            giver: Number of the stage that gave it. None: it comes from outside.
        """
        for reader in self._wiring.readers.get(topic, ()):
            if reader.stage in self._closed:
                continue
            if self._wiring.comes_back(reader, giver):
                self._back[reader.stage].append(record)
            else:
                self.wait(reader, record, place)

    def wait(self, reader: TopicReader, record: Any, place: Place) -> None:
        """Add a record for one stage."""
        rank = self._wiring.ranks[reader.stage]
        port = self._wiring.port(reader)
        self._number += 1
        time = (*place, rank + (FIRST if port.first else 0))
        beside = self._wiring.is_beside(reader)
        heappush(self._waiting[reader.stage], (time, self._number, record, beside))

    def close(self, stage: int) -> None:
        """Close a stage: it takes no more records."""
        self._closed.add(stage)
        self._waiting[stage].clear()
        self._back[stage].clear()

    def open_all(self) -> None:
        """Open all stages again."""
        self._closed.clear()

    def place_of_next(self, turn: StageTurn, topic: str) -> Place:
        """Return the place of the next output of a stage at its turn."""
        head = self._open[-1] if self._open else None
        if head is not None and (head.turn.stage, head.turn.time) != (turn.stage, turn.time):
            head = None
        if head is not None:
            head.given += 1
        if TOPICS[topic].by_stamp:
            place = (*turn.time[:-2], number_of(topic))
            if head is not None:
                head.last = place
            return place
        if head is not None:
            return (*turn.time, head.given)
        count = self._given[1] + 1 if self._given[0] == turn.time else 1
        self._given = turn.time, count
        return (*turn.time, count)

    def next(self, bounds: Bounds | None) -> StageTurn | None:
        """Return the next turn; None if it is not determined yet or nothing waits."""
        while self._open:
            head = self._open[-1]
            turn = self._earliest(bounds)
            if turn is not None and turn.time < head.floor:
                return self._begun(turn)
            if any(waiting and waiting[0][0] < head.floor for waiting in self._waiting):
                waiting = {other.turn.stage for other in self._open}
                return self._begun(self._earliest(bounds, waiting))  # earlier stages continue meanwhile
            stage = head.turn.stage
            if self._back[stage]:
                return StageTurn(head.turn.time, stage, self._back[stage].popleft(), True)
            self._open.pop()
        return self._begun(self._earliest(bounds))

    def is_over(self, stage: int, bounds: Bounds) -> bool:
        """Return whether a stage has processed everything that it will get, so that it may be flushed."""
        above = self._wiring.above[stage]
        return (
            stage not in self._closed
            and bounds(stage) == (DONE,)
            and all(other in self._closed for other in above if other != stage)
            and not any(self._waiting[other] for other in above)
            and not any(head.turn.stage in above for head in self._open)
        )

    # ------------------------------------------------------------------ turns

    def _begun(self, turn: StageTurn | None) -> StageTurn | None:
        """Remove the record of a turn from its queue and return the turn."""
        if turn is not None:
            heappop(self._waiting[turn.stage])
            if turn.stage in self._wiring.heads:
                self._open.append(_OpenRecord(turn))
        return turn

    def _earliest(self, bounds: Bounds | None, held: Collection[int] = ()) -> StageTurn | None:
        """Return the earliest turn that no record from outside can precede; None if there is none.

        A stage that waits for outside records holds up the later stages that depend on it.

        Args:
            held: Stages that wait in any case.
        """
        heads = sorted((waiting[0][0], stage) for stage, waiting in enumerate(self._waiting) if waiting)
        held = set(held)
        for time, stage in heads:
            if held & self._wiring.above[stage]:
                continue
            if bounds is None or time <= bounds(stage):
                _, _, record, beside = self._waiting[stage][0]
                return StageTurn(time, stage, record, beside)
            held.add(stage)
        return None
