"""What a node publishes: a message only where somebody wants one."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import Any

from rclpy.node import Node

from panoptic_ros.domain import Rig
from panoptic_ros.graph.flow import Flow
from panoptic_ros.graph.schedule import Place
from panoptic_ros.graph.topics import TOPICS, owner_of
from panoptic_ros.io.messages import to_message
from panoptic_ros.io.messages.records import Origins
from panoptic_ros.nodes.flow.progress import ProgressTold
from panoptic_ros.nodes.flow.streams import StreamEnds
from panoptic_ros.nodes.middleware.family import message_class, ros_messages
from panoptic_ros.nodes.middleware.quality import CLOCKS, data_quality


class Outputs:
    """Publishers of topics.

    Args:
        leaving: keys of topics that are always published; others only while somebody subscribes.
        ends: tells the ends of topics (replay). progress: tells how far they have come.

    Attributes:
        origins: of records that go on inside of messages that leave the process.
    """

    def __init__(
        self,
        node: Node,
        flow: Flow,
        leaving: Collection[str],
        ends: StreamEnds,
        progress: ProgressTold | None,
    ):
        self._node, self._flow, self._leaving = node, flow, frozenset(leaving)
        self._ends, self._progress = ends, progress
        self.origins = Origins(TOPICS[topic].record for topic in leaving)
        self._messages = replace(ros_messages(), origin=self.origins.of)
        self._publishers: dict[tuple[str, str], Any] = {}
        self._sent: dict[tuple[str, str], int] = {}

    def open(self, topic: str, owner: str) -> None:
        """Make the publisher of a topic of a camera or device."""
        row = TOPICS[topic]
        quality = CLOCKS if row.latched else data_quality(self._flow, sound=row.scope == "device")
        self._publishers[topic, owner] = self._node.create_publisher(
            message_class(row.message), row.of(owner), quality
        )

    def __len__(self) -> int:
        return len(self._publishers)

    def publish(self, topic: str, record: Any, rig: Rig) -> bool:
        """Publish a record, if it leaves the process or somebody subscribes; whether it was."""
        key = topic, owner_of(topic, record)
        publisher = self._publishers[key]
        if topic not in self._leaving and not publisher.get_subscription_count():
            return False
        publisher.publish(to_message(record, self._messages, rig.frame_id))
        self._sent[key] = self._sent.get(key, 0) + 1
        return True

    def mark(self, topic: str, owner: str, place: Place) -> None:
        """Tell how far a topic has come."""
        if self._progress is not None:
            name = self._publishers[topic, owner].topic_name
            self._progress.tell(name, self._sent.get((topic, owner), 0), place)

    def end(self, topic: str, owner: str | None = None) -> None:
        """Tell that no more comes on a topic, of one camera or device or (None) of all that were not told
        yet.
        """
        for key in [key for key in self._publishers if key[0] == topic and owner in (None, key[1])]:
            if self._sent.get(key, 0) >= 0:
                self._ends.announce(self._publishers[key].topic_name, self._sent.get(key, 0))
                self._sent[key] = -1
