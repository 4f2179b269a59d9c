"""Joint polling of many subscriptions of a node, in the order of their timestamps.

The executor wakes a node for every message. For 52 devices at 60 Hz this costs more than the messages
themselves. A node that has fallen behind would also take all waiting messages of one device before those of
the next. That device would then appear to run ahead of the others. Here one timer polls all subscriptions.
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

LOOK_S = 0.004  # polling period: a tenth of a camera's period or less
MOST_LEFT_OUT = 2  # polls that may be skipped per source; more would delay its next message


class ReceivedMessage(NamedTuple):
    """Message as bytes, with the sequence number that the publisher's middleware gave it."""

    data: bytes
    number: int


class PolledSubscription(Protocol):
    """Subscription that is polled together with others."""

    def waiting(self) -> list[ReceivedMessage]:
        """Return all messages that wait in the middleware."""

    def take(self, came: ReceivedMessage) -> None:
        """Process one of these messages."""


class SubscriptionPoller:
    """Poller of several subscriptions of a node.

    Args:
        at_once: returns a context in which the messages of one poll are processed.
    """

    def __init__(self, node: Node, at_once: Callable[[], AbstractContextManager[None]]):
        self._node, self._at_once = node, at_once
        self._sources: list[_PollSchedule] = []
        self._subscriptions: set[Subscription] = set()
        self._timer: Any = None

    def __contains__(self, subscription: Subscription) -> bool:
        return subscription in self._subscriptions

    def add(self, source: PolledSubscription) -> None:
        """Poll one more source from now on."""
        self._sources.append(_PollSchedule(source))
        if self._timer is None:
            clock = Clock(clock_type=ClockType.STEADY_TIME)
            self._timer = self._node.create_timer(LOOK_S, self.read, clock=clock)

    def keep(self, subscription: Subscription) -> None:
        """Exclude a subscription of a source from the executor."""
        self._subscriptions.add(subscription)

    def forget(self, subscription: Subscription) -> None:
        """Remove a subscription that is about to be destroyed."""
        self._subscriptions.discard(subscription)

    def read(self) -> None:
        """Process all waiting messages in the order of their timestamps."""
        found = [row for looked in self._sources for row in looked.waiting()]
        if not found:
            return
        found.sort(key=lambda row: row[0])
        with self._at_once():
            for _, source, came in found:
                source.take(came)


class _PollSchedule:
    """Source that is not polled in the first half of its message period.

    No message comes in that time, and a poll takes as long as receiving a message.
    """

    def __init__(self, source: PolledSubscription):
        self._source = source
        self._newest_ns = 0
        self._left_out = 0  # polls that are still to be skipped

    def waiting(self) -> list[tuple[int, PolledSubscription, ReceivedMessage]]:
        """Return all waiting messages with their timestamps (ns) and their source."""
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
    """Node with subscriptions that it polls itself; executors do not see these."""

    together: SubscriptionPoller | None = None

    @property
    def subscriptions(self) -> Iterator[Subscription]:
        """Yield the subscriptions that an executor reads."""
        for subscription in super().subscriptions:
            if self.together is None or subscription not in self.together:
                yield subscription
