"""End of stream: how readers know in replay that a topic is over, and that they have all of it."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from rclpy.node import Node

from panoptic_ros.nodes.middleware.family import message_class
from panoptic_ros.nodes.middleware.quality import END_OF_STREAM

TOPIC = "end_of_stream"
END_KIND = "panoptic_msgs/msg/EndOfStream"


class StreamEnds:
    """Announces the ends of a node's own topics and watches those of the topics it reads.

    A stream is over for a reader when it has taken as many messages as the writer has sent. Several
    writers cannot share a topic in replay.
    """

    def __init__(self, node: Node, on_end: Callable[[str], None]):
        self._message = message_class(END_KIND)
        self._publisher = node.create_publisher(self._message, TOPIC, END_OF_STREAM)
        self._subscription = node.create_subscription(self._message, TOPIC, self._ended, END_OF_STREAM)
        self._on_end = on_end
        self._lock = threading.Lock()  # messages are counted by a worker, ends come on the executor
        self._expected: dict[str, int] = {}
        self._taken: dict[str, int] = {}
        self._over: set[str] = set()
        self._watched: set[str] = set()

    def watch(self, topic: str) -> None:
        """Start to count the messages of a topic (its full name)."""
        with self._lock:
            self._watched.add(topic)
        self._check(topic)

    def taken(self, topic: str) -> None:
        """One more message of a topic has come."""
        with self._lock:
            self._taken[topic] = self._taken.get(topic, 0) + 1
        self._check(topic)

    def announce(self, topic: str, count: int) -> None:
        """Tell all readers that `count` messages were all of this topic."""
        self._publisher.publish(self._message(topic=topic, count=count))

    def _ended(self, message: Any) -> None:
        with self._lock:
            self._expected[message.topic] = int(message.count)
        self._check(message.topic)

    def _check(self, topic: str) -> None:
        with self._lock:
            known = topic in self._watched and topic in self._expected and topic not in self._over
            if not known or self._taken.get(topic, 0) < self._expected[topic]:
                return
            self._over.add(topic)
        self._on_end(topic)
