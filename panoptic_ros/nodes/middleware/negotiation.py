"""Subscriptions that adapt their QoS to the publishers.

Camera drivers often offer best effort only.
"""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Mapping
from typing import Any

from rclpy.event_handler import QoSRequestedIncompatibleQoSInfo, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSPolicyKind, QoSProfile, ReliabilityPolicy, qos_policy_name_from_kind

from panoptic_ros.nodes.middleware.read_together import ReceivedMessage, SubscriptionPoller
from panoptic_ros.nodes.middleware.runtime import OneShot, with_facts
from panoptic_ros.stage import Notice

CLOSE_S = 0.003  # s between two messages; at a shorter interval, more messages are waiting
MOST_AT_ONCE = 64  # messages taken in a row before other topics get their turn
BEST_EFFORT_DEPTH = 5  # as in ROS's QoS profile for sensor data


class NegotiatedSubscription:
    """Subscription that starts reliable and falls back to best effort if a publisher offers only that.

    Reliable publishers still reach it then, but without guaranteed delivery. Only the reliability is relaxed.
    Any other QoS mismatch is reported with its remedy.

    Args:
        topic: name.
        take: called with the bytes of every message and its sequence number in the middleware.
        quality: QoS that is requested first.
        gives_way: whether the subscription may fall back to best effort (live).
        tell: called with a notice about a QoS mismatch.
        together: reads the subscription; None: the executor does.
    """

    def __init__(
        self,
        node: Node,
        kind: Any,
        topic: str,
        take: Callable[[bytes, int], None],
        quality: QoSProfile,
        gives_way: bool,
        tell: Callable[[Notice], None],
        together: SubscriptionPoller | None = None,
    ):
        self._node, self._kind, self._topic, self._take = node, kind, topic, take
        self._quality, self._gives_way, self._tell, self._together = quality, gives_way, tell, together
        self._again: OneShot | None = None
        self._pause: OneShot | None = None
        self._newest_s = 0.0  # monotonic time of the newest message
        self._subscription = self._subscribe()
        self._name = str(self._subscription.topic_name)
        if together is not None:
            together.add(self)

    @property
    def topic_name(self) -> str:
        """Return the full topic name."""
        return self._name

    @property
    def is_reliable(self) -> bool:
        """Return whether lost messages are sent again."""
        return bool(self._quality.reliability == ReliabilityPolicy.RELIABLE)

    def _subscribe(self) -> Any:
        events = SubscriptionEventCallbacks(incompatible_qos=self._does_not_fit)

        def take(data: bytes, info: Mapping[str, Any]) -> None:
            if self._pause is not None:
                return
            self._take(data, info["publication_sequence_number"])
            now, before = time.monotonic(), self._newest_s
            self._newest_s = now
            if now - before < CLOSE_S:
                self._drain()

        made = self._node.create_subscription(
            self._kind, self._topic, with_facts(take), self._quality, event_callbacks=events, raw=True
        )
        if self._together is not None:
            self._together.keep(made)
        return made

    def _unsubscribe(self) -> None:
        if self._together is not None:
            self._together.forget(self._subscription)
        self._node.destroy_subscription(self._subscription)

    def _drain(self) -> None:
        """Take all waiting messages at once: a wake-up of the executor costs more than a message."""
        handle = self._subscription.handle
        with handle:
            for _ in range(MOST_AT_ONCE - 1):
                found = handle.take_message(self._kind, True) if self._pause is None else None
                if found is None:
                    return
                self._take(found[0], found[1]["publication_sequence_number"])

    def waiting(self) -> list[ReceivedMessage]:
        """Return the waiting messages; see `nodes.read_together.PolledSubscription`."""
        came: list[ReceivedMessage] = []
        if self._pause is not None:
            return came
        handle, kind = self._subscription.handle, self._kind
        with handle:
            while found := handle.take_message(kind, True):
                came.append(ReceivedMessage(found[0], found[1]["publication_sequence_number"]))
                if len(came) >= self._quality.depth:
                    break
        return came

    def take(self, came: ReceivedMessage) -> None:
        """Process a message; see `nodes.read_together.PolledSubscription`."""
        if self._pause is None:
            self._take(*came)

    def pause(self, seconds: float, resumed: Callable[[], None]) -> None:
        """Unsubscribe for some time, so that publishers do not even send.

        Args:
            seconds: duration of the pause.
            resumed: called when the subscription exists again.
        """

        def begin() -> None:  # deferred: a subscription cannot be destroyed in its own callback
            self._unsubscribe()
            self._pause = OneShot(self._node, seconds, end)

        def end() -> None:
            self._pause = None
            self._subscription = self._subscribe()
            resumed()

        self._pause = OneShot(self._node, 0.0, begin)

    def _does_not_fit(self, info: QoSRequestedIncompatibleQoSInfo) -> None:
        policy = QoSPolicyKind(info.last_policy_kind)
        if policy == QoSPolicyKind.RELIABILITY and self._gives_way and self.is_reliable:
            if self._again is None:  # deferred: a subscription cannot be destroyed in its own callback
                self._again = OneShot(self._node, 0.0, self._give_way)
            return
        name = qos_policy_name_from_kind(policy).lower()
        text = (
            f"a publisher of {self.topic_name} is incompatible: its {name} differs from the required "
            f"one, so its messages are not received; use the {name} of the other publishers, or another topic"
        )
        self._tell(Notice("graph.incompatible_qos", "warning", text, {"device": self._topic}))

    def _give_way(self) -> None:
        self._again = None
        if self._pause is None:
            self._unsubscribe()
        self._quality = copy.copy(self._quality)
        self._quality.reliability = ReliabilityPolicy.BEST_EFFORT
        self._quality.depth = max(self._quality.depth, BEST_EFFORT_DEPTH)
        if self._pause is None:
            self._subscription = self._subscribe()
        text = f"{self.topic_name} is received as best effort, as a publisher offers no more"
        self._tell(Notice("graph.best_effort", "info", text, {"device": self._topic}))
