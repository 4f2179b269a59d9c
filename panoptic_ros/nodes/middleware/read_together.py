"""Topics that a node reads at a time: what comes of many devices, in the order of its stamps.

The executor wakes a node for every message. Of 52 devices at 60 Hz that costs more than the messages
themselves, and a node that has fallen behind takes all that waits of one device before it gets to the next,
so that one seems to run ahead of the others. Here a timer looks at all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from typing import Any, NamedTuple, Protocol

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.subscription import Subscription

from panoptic_ros.nodes.middleware.packets import stamp_in

LOOK_S = 0.004  # between looks: a tenth of a camera's period or less
MOST_LEFT_OUT = 2  # looks at a source: later than its next message it must not be looked at


class Came(NamedTuple):
    """A message as bytes, and its number by the middleware of its publisher."""

    data: bytes
    number: int


class Source(Protocol):
    """A subscription that is read together with others."""

    def waiting(self) -> list[Came]:
        """All that waits in the middleware."""

    def take(self, came: Came) -> None:
        """Take one of these."""


class ReadTogether:
    """Reads subscriptions of a node at a time.

    Args:
        at_once: entered while what has come is taken.
    """

    def __init__(self, node: Node, at_once: Callable[[], AbstractContextManager[None]]):
        self._node, self._at_once = node, at_once
        self._sources: list[_Looked] = []
        self._subscriptions: set[Subscription] = set()
        self._timer: Any = None

    def __contains__(self, subscription: Subscription) -> bool:
        return subscription in self._subscriptions

    def add(self, source: Source) -> None:
        """Read one more source from now on."""
        self._sources.append(_Looked(source))
        if self._timer is None:
            clock = Clock(clock_type=ClockType.STEADY_TIME)
            self._timer = self._node.create_timer(LOOK_S, self.read, clock=clock)

    def keep(self, subscription: Subscription) -> None:
        """Leave a subscription of a source out of what the executor reads."""
        self._subscriptions.add(subscription)

    def forget(self, subscription: Subscription) -> None:
        """A subscription is destroyed."""
        self._subscriptions.discard(subscription)

    def read(self) -> None:
        """Take all that waits."""
        found = [row for looked in self._sources for row in looked.waiting()]
        if not found:
            return
        found.sort(key=lambda row: row[0])
        with self._at_once():
            for _, source, came in found:
                source.take(came)


class _Looked:
    """A source, at which nobody looks for the first half of its period: nothing comes then, and to look takes
    as long as to take a message."""

    def __init__(self, source: Source):
        self._source = source
        self._newest_ns = 0
        self._left_out = 0  # looks to come

    def waiting(self) -> list[tuple[int, Source, Came]]:
        """All that waits, by its stamps."""
        if self._left_out:
            self._left_out -= 1
            return []
        found = [(stamp_in(came.data), self._source, came) for came in self._source.waiting()]
        if found:
            before, self._newest_ns = self._newest_ns, found[-1][0]
            looks = 0.5e-9 * (found[0][0] - before) / LOOK_S if len(found) == 1 else 0.0
            self._left_out = int(min(max(looks, 0.0), MOST_LEFT_OUT))
        return found


class GatheringNode(Node):
    """A node with subscriptions that it reads together; executors are not told of these."""

    together: ReadTogether | None = None

    @property
    def subscriptions(self) -> Iterator[Subscription]:
        """Those that an executor reads."""
        for subscription in super().subscriptions:
            if self.together is None or subscription not in self.together:
                yield subscription
