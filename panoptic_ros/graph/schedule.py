"""In which order stages take records: the same in one process and in the standard graph.

Every record has a place, a tuple of whole numbers that is compared from the left. Records from sources have
places by their stamps (`graph.host`). A stage of rank s takes a record of place p at the turn p + (s,),
and gives its n-th record for it the place p + (s, n). A stage takes records in the order of their turns. So
all that follows from a record in the stages above is done before a stage below takes it, and places of what
a stage gives never go back. A port that is marked `first` takes records before all others do. A record that
follows one of a source by its stamp has the place of that one, but for the topic, which comes last in such
places (`graph.host`).

A stage to which something comes back from below (a head) has one record at hand: it takes the next after
all that follows from it is done, and after what came back. What it gives for that has the next places after
what it gave before.

Places are the logical times of a conservative simulation in the sense of Chandy and Misra (1979); nested
times as in Naiad (Murray et al. 2013).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection
from dataclasses import dataclass
from heapq import heappop, heappush
from typing import Any, NamedTuple

from panoptic_ros.graph.topics import TOPICS, number_of
from panoptic_ros.graph.wiring import Reader, Wiring

Place = tuple[int, ...]
DONE = 2**63 - 1  # p + (DONE,) is beyond all that follows from p
END = DONE - 1  # p + (END,): the end of a stream whose last record was at p
FLUSH = DONE - 1  # time of what stages hand out at the end
FIRST = -(2**31)  # added to the rank of a stage whose port comes first
Bounds = Callable[[int], Place]  # of a stage: nothing that is to come from outside has a place before


class Turn(NamedTuple):
    """A stage takes a record; `beside`: one of an optional port, which the main work does not follow from."""

    time: Place
    stage: int
    record: Any
    beside: bool = False


@dataclass
class _Open:
    """The record that a head has at hand: its turn, and how many records were given for it.

    Args:
        last: place of the newest that was given, if its stamp tells it.
    """

    turn: Turn
    given: int = 0
    last: Place = ()

    @property
    def floor(self) -> Place:
        """All that follows from what was given has places before this one."""
        return (*self.last, DONE) if self.last else (*self.turn.time, self.given + 1)


class Schedule:
    """What waits for the stages of one process."""

    def __init__(self, wiring: Wiring):
        self._wiring = wiring
        self._waiting: list[list[tuple[Place, int, Any, bool]]] = [[] for _ in wiring.specs]  # heaps by turns
        self._back: list[deque[Any]] = [deque() for _ in wiring.specs]
        self._open: list[_Open] = []  # the innermost last
        self._given: tuple[Place, int] = (
            (),
            0,
        )  # turn at hand of a stage that is no head, and records given for it
        self._number = 0
        self._closed: set[int] = set()

    def add(self, topic: str, record: Any, place: Place, giver: int | None = None) -> None:
        """A record for all stages that take its topic.

        Args:
            giver: the stage that gave it; None: it comes from outside.
        """
        for reader in self._wiring.readers.get(topic, ()):
            if reader.stage in self._closed:
                continue
            if self._wiring.comes_back(reader, giver):
                self._back[reader.stage].append(record)
            else:
                self.wait(reader, record, place)

    def wait(self, reader: Reader, record: Any, place: Place) -> None:
        """A record for one stage."""
        rank = self._wiring.ranks[reader.stage]
        port = self._wiring.port(reader)
        self._number += 1
        time = (*place, rank + (FIRST if port.first else 0))
        beside = self._wiring.is_beside(reader)
        heappush(self._waiting[reader.stage], (time, self._number, record, beside))

    def close(self, stage: int) -> None:
        """A stage takes nothing any more."""
        self._closed.add(stage)
        self._waiting[stage].clear()
        self._back[stage].clear()

    def open_all(self) -> None:
        """All stages take records again."""
        self._closed.clear()

    def place_of_next(self, turn: Turn, topic: str) -> Place:
        """The place of the next record that a stage gives at its turn."""
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

    def next(self, bounds: Bounds | None) -> Turn | None:
        """Whose turn it is; None: that is not known yet, or nothing waits."""
        while self._open:
            head = self._open[-1]
            turn = self._earliest(bounds)
            if turn is not None and turn.time < head.floor:
                return self._begun(turn)
            if any(waiting and waiting[0][0] < head.floor for waiting in self._waiting):
                waiting = {other.turn.stage for other in self._open}
                return self._begun(self._earliest(bounds, waiting))  # stages above go on meanwhile
            stage = head.turn.stage
            if self._back[stage]:
                return Turn(head.turn.time, stage, self._back[stage].popleft(), True)
            self._open.pop()
        return self._begun(self._earliest(bounds))

    def is_over(self, stage: int, bounds: Bounds) -> bool:
        """Whether a stage has taken all that it will get, and may hand out what it holds."""
        above = self._wiring.above[stage]
        return (
            stage not in self._closed
            and bounds(stage) == (DONE,)
            and all(other in self._closed for other in above if other != stage)
            and not any(self._waiting[other] for other in above)
            and not any(head.turn.stage in above for head in self._open)
        )

    # ------------------------------------------------------------------ turns

    def _begun(self, turn: Turn | None) -> Turn | None:
        """The turn, which is taken now."""
        if turn is not None:
            heappop(self._waiting[turn.stage])
            if turn.stage in self._wiring.heads:
                self._open.append(_Open(turn))
        return turn

    def _earliest(self, bounds: Bounds | None, held: Collection[int] = ()) -> Turn | None:
        """The earliest turn that nothing can come before; a stage that waits holds up those below it.

        Args:
            held: stages that wait in any case.
        """
        heads = sorted((waiting[0][0], stage) for stage, waiting in enumerate(self._waiting) if waiting)
        held = set(held)
        for time, stage in heads:
            if held & self._wiring.above[stage]:
                continue
            if bounds is None or time <= bounds(stage):
                _, _, record, beside = self._waiting[stage][0]
                return Turn(time, stage, record, beside)
            held.add(stage)
        return None
