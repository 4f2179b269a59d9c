"""Node that records raw messages of selected topics.

The node also subscribes to topics that appear later.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from panoptic_ros.errors import EnvironmentProblem
from panoptic_ros.io.bag_connections import Connection
from panoptic_ros.io.definitions import described
from panoptic_ros.nodes.middleware.family import message_class

LOOK_S = 0.5  # period of the search for new topics
LATCHED_DEPTH = 64  # messages per latched topic that are repeated at the beginning of every recording
LATCHED_SIZE = 4_000_000  # bytes; larger ones are data of a replay, whose data topics are latched too
Take = Callable[[Connection, int, bytes], None]  # (topic, time of arrival in ns, CDR bytes)


class RecorderNode(Node):
    """Node that subscribes to topics as CDR bytes, with the QoS that their publishers offer.

    Args:
        wanted: Returns whether to record a topic, given its name and message type.
        take: Called with every message.
        tell: Called with one line about a topic that cannot be recorded.
    """

    def __init__(
        self, name: str, wanted: Callable[[str, str], bool], take: Take, tell: Callable[[str], None]
    ):
        super().__init__(name)
        self._wanted, self._take, self._tell = wanted, take, tell
        self._subscriptions_by_topic: dict[str, Any] = {}
        self._latched: dict[str, list[tuple[Connection, bytes]]] = {}
        self._told: set[str] = set()
        self.look()
        self._timer = self.create_timer(LOOK_S, self.look)

    @property
    def topics(self) -> tuple[str, ...]:
        """Return the recorded topics."""
        return tuple(self._subscriptions_by_topic)

    @property
    def latched(self) -> list[tuple[Connection, bytes]]:
        """Return the newest messages of latched topics. Any thread may call this."""
        return [item for items in list(self._latched.values()) for item in list(items)]

    def look(self) -> None:
        """Subscribe to wanted topics that have appeared."""
        for topic, kinds in self.get_topic_names_and_types():
            if topic in self._subscriptions_by_topic or not self._wanted(topic, kinds[0]):
                continue
            infos = self.get_publishers_info_by_topic(topic)
            if infos:
                self._subscribe(topic, infos)

    def _subscribe(self, topic: str, infos: list[Any]) -> None:
        kind = str(infos[0].topic_type)
        try:
            cls = message_class(kind)
        except (EnvironmentProblem, AttributeError):
            self._tell_once(topic, f"{topic} is not recorded: its messages, {kind}, are not installed here")
            return
        connection = described(topic, kind)
        if connection is None:
            self._tell_once(topic, f"{topic} is not recorded: the definition of {kind} is found nowhere")
            return
        offered = [info.qos_profile for info in infos]
        reliable = all(q.reliability == ReliabilityPolicy.RELIABLE for q in offered)
        latched = all(q.durability == DurabilityPolicy.TRANSIENT_LOCAL for q in offered)
        connection = connection.offered(reliable, latched)
        quality = QoSProfile(
            history=HistoryPolicy.KEEP_ALL,
            reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        )

        def take(data: bytes) -> None:
            if latched and len(data) < LATCHED_SIZE:
                kept = self._latched.setdefault(topic, [])
                kept.append((connection, data))
                del kept[:-LATCHED_DEPTH]
            self._take(connection, self.get_clock().now().nanoseconds, data)

        self._subscriptions_by_topic[topic] = self.create_subscription(cls, topic, take, quality, raw=True)

    def _tell_once(self, topic: str, line: str) -> None:
        if topic not in self._told:
            self._told.add(topic)
            self._tell(line)
