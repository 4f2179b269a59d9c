"""How records reach the stages of a node: live as they come, in replay in the order of their places."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

from panoptic_ros.graph.host import Host, Key
from panoptic_ros.graph.under_way import UnderWay


class Arrival(NamedTuple):
    """What has come on a topic of a camera or device, and when, on the monotonic clock; record None: it could
    not be used."""

    topic: str
    owner: str
    stamp_ns: int
    record: Any | None
    came_ns: int


class Delivery(Protocol):
    """All methods are called on the node's worker."""

    def take(self, arrivals: Sequence[Arrival]) -> None:
        """What has come, of one instant where it is known to be."""

    def wait(self) -> None:
        """Until no stage is at work."""


class LiveDelivery:
    """Stages take records as they come.

    Args:
        now_ns: the clock that stamps of cameras should be on.
    """

    def __init__(self, under_way: UnderWay, now_ns: Callable[[], int] = time.time_ns):
        self._under_way, self._now_ns = under_way, now_ns

    def take(self, arrivals: Sequence[Arrival]) -> None:
        came_ns = arrivals[0].came_ns
        waited_ns = time.monotonic_ns() - came_ns
        self._under_way.waited(waited_ns)
        self._under_way.arrived(came_ns, self._now_ns() - waited_ns)
        self._under_way.begin([(one.topic, one.record) for one in arrivals if one.record is not None])

    def wait(self) -> None:
        self._under_way.wait()


class ReplayDelivery:
    """Stages take records in the order of their places, whatever comes first (see `graph.host`).

    Args:
        on_over: called when all topics have ended and all is taken; may be called again.
    """

    def __init__(self, host: Host, on_over: Callable[[], None]):
        self.host, self._on_over = host, on_over

    def take(self, arrivals: Sequence[Arrival]) -> None:
        for one in arrivals:
            self.host.put(one.topic, one.owner, one.stamp_ns, one.record)
        self._advance()

    def wait(self) -> None:
        """One record is taken after the other."""

    def end(self, key: Key) -> None:
        """No more comes on a topic of a camera or device."""
        self.host.end(*key)
        self._advance()

    def _advance(self) -> None:
        self.host.advance()
        if self.host.over:
            self._on_over()
