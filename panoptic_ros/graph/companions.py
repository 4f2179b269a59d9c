"""Live: records that wait for others of the same camera, e.g. images for their depth maps."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from panoptic_ros.graph.nodes import Port


class Item(NamedTuple):
    """What has come on a topic of a camera or device, and when, on the monotonic clock."""

    topic: str
    owner: str
    stamp_ns: int
    message: Any
    came_ns: int = 0


@dataclass
class _Beside:
    """The companions of one topic that wait for their record."""

    port: Port
    waiting: deque[Item] = field(default_factory=deque)


class Companions:
    """Puts records and their companions together; the records of a camera stay in order.

    A record waits until every companion topic of its camera has shown one that is late enough, or a record
    has come that is later by more than the patience of the port.

    Args:
        ports: of the companions, each with a patience and the time by which it is handed over ahead.
        present: (topic, owner) that there are.
    """

    def __init__(self, ports: Sequence[Port], present: Collection[tuple[str, str]]):
        self._beside: dict[str, list[_Beside]] = {}
        self._records: dict[str, deque[Item]] = {}
        topics = {port.topic: port for port in ports}
        for topic, owner in sorted(present):
            if topic in topics:
                self._beside.setdefault(owner, []).append(_Beside(topics[topic]))
                self._records[owner] = deque()

    def put(self, item: Item) -> list[tuple[Item, ...]]:
        """Take what has come; gives what is ready, each record behind its companions."""
        if item.owner not in self._beside:
            return [(item,)]
        for beside in self._beside[item.owner]:
            if beside.port.topic == item.topic:
                self._keep(beside, item)
                return self._ready(item.owner, None)
        self._records[item.owner].append(item)
        return self._ready(item.owner, item.stamp_ns)

    def _keep(self, beside: _Beside, item: Item) -> None:
        """Add a companion; those of a camera whose records fail must not pile up."""
        waiting = beside.waiting
        while waiting and not 0 <= item.stamp_ns - waiting[0].stamp_ns <= beside.port.patience_ns:
            waiting.popleft()
        waiting.append(item)

    def _ready(self, owner: str, newest_ns: int | None) -> list[tuple[Item, ...]]:
        records, found = self._records[owner], []
        while records and all(_has_come(b, records[0].stamp_ns, newest_ns) for b in self._beside[owner]):
            record = records.popleft()
            early = [item for b in self._beside[owner] for item in _before(b, record.stamp_ns)]
            found.append((*early, record))
        return found


def _has_come(beside: _Beside, stamp_ns: int, newest_ns: int | None) -> bool:
    """Whether no companion of a record is waited for any more."""
    late = newest_ns is not None and newest_ns - stamp_ns >= beside.port.patience_ns
    return late or any(item.stamp_ns > stamp_ns - beside.port.ahead_ns for item in beside.waiting)


def _before(beside: _Beside, stamp_ns: int) -> list[Item]:
    """The companions that are handed over before a record."""
    found = []
    while beside.waiting and beside.waiting[0].stamp_ns < stamp_ns + beside.port.ahead_ns:
        found.append(beside.waiting.popleft())
    return found
