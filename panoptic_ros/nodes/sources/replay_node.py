"""Node that publishes CDR bytes of a bag on its topics, and the time of the bag on /clock."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from panoptic_ros.errors import EnvironmentProblem
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.bag_connections import Connection
from panoptic_ros.nodes.middleware.family import message_class, ros_messages

LATCHED_NAMES = tuple("/" + topic.name for topic in TOPICS.values() if topic.latched) + ("/tf_static",)
DEPTH = 100
LATCHED_DEPTH = 64
ARRIVAL_S = 2.0  # longest wait for the delivery of the last messages to all subscribers


class ReplayNode(Node):
    """Node with publishers for the topics of a bag.

    Args:
        connections: the topics.
        space: namespace in front of their names, "" = none.
        with_clock: also publish /clock.
        tell: called with a line about a topic that cannot be published.
    """

    def __init__(
        self, connections: list[Connection], space: str, with_clock: bool, tell: Callable[[str], None]
    ):
        super().__init__("replay")
        self._publishers_by_topic: dict[str, Any] = {}
        for connection in connections:
            try:
                kind = message_class(connection.kind)
            except (EnvironmentProblem, AttributeError):
                lacking = f"its messages, {connection.kind}, are not installed here"
                tell(f"{connection.topic} is left out: {lacking}")
                continue
            name = f"{space.rstrip('/')}{connection.topic}"
            self._publishers_by_topic[connection.topic] = self.create_publisher(
                kind, name, _quality(connection)
            )
        self._clock: Any = None
        if with_clock:
            self._clock = self.create_publisher(message_class("rosgraph_msgs/msg/Clock"), "/clock", 10)

    @property
    def topics(self) -> tuple[str, ...]:
        """Return the topics of the bag that can be published."""
        return tuple(self._publishers_by_topic)

    def heard(self, topics: Collection[str]) -> int:
        """Return the number of these topics that have a subscriber."""
        return sum(self._publishers_by_topic[topic].get_subscription_count() > 0 for topic in topics)

    def publish(self, topic: str, data: bytes) -> None:
        """Publish a raw message."""
        self._publishers_by_topic[topic].publish(data)

    def tell_time(self, stamp_ns: int) -> None:
        """Publish the time of the bag on /clock."""
        if self._clock is not None:
            header = ros_messages().header(stamp_ns, "")
            self._clock.publish(ros_messages().make("rosgraph_msgs/msg/Clock", clock=header.stamp))

    def wait_for_arrival(self) -> None:
        """Wait until subscribers have received the published messages.

        Messages that a program sends just before it ends may be lost.
        """
        end = time.monotonic() + ARRIVAL_S
        publishers = [*self._publishers_by_topic.values(), *([self._clock] if self._clock else [])]
        for publisher in publishers:
            publisher.wait_for_all_acked(Duration(seconds=max(0.0, end - time.monotonic())))


def is_latched(connection: Connection) -> bool:
    """Return whether messages of a topic are kept for late subscribers."""
    return connection.is_latched or connection.topic.endswith(LATCHED_NAMES)


def _quality(connection: Connection) -> QoSProfile:
    """Return the QoS that was offered when the topic was recorded; reliable if the bag does not state it."""
    latched, effort = is_latched(connection), connection.is_best_effort
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=LATCHED_DEPTH if latched else DEPTH,
        reliability=ReliabilityPolicy.BEST_EFFORT if effort else ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )
