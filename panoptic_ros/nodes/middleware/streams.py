"""End of stream: how readers know in replay that a topic is over, and that they have all of it.

How sources in replay wait for what comes out (see `graph.flow`).
"""

from __future__ import annotations

import struct
import threading
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.node import Node

from panoptic_ros.graph.flow import Flow
from panoptic_ros.nodes.middleware.family import message_class
from panoptic_ros.nodes.middleware.quality import END_OF_STREAM, collecting_quality

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


STALL_S = 60.0  # replay: nothing comes out for so long: send one more, in case a set was refused
AHEAD_NS = 60_000_000_000  # by which sound may be ahead of skeletons


class Credit:
    """Counts what a source has sent and has not yet seen come out of a topic further down.

    Needs the stamps of the messages only, which stand first in all of them, so it takes them raw. Every
    stream of a source is counted on its own, as queues are.

    Args:
        window: messages of a stream that may be under way.
        shift_ns: what is added to the stamps of what is sent, which may be on another clock.
    """

    def __init__(self, node: Node, flow: Flow, topic: str, message: str, window: int, shift_ns: int = 0):
        self._window = window
        self._shift = shift_ns
        self._under_way: dict[str, deque[int]] = {}
        self._done_until = -1
        self._changed = threading.Condition()
        self._subscription = node.create_subscription(
            message_class(message), topic, self._came_out, collecting_quality(flow), raw=True
        )

    def wait(self, stream: str, timeout_s: float) -> bool:
        """Wait until one more of a stream may be sent; False if the time ran out."""
        with self._changed:
            own = self._under_way.setdefault(stream, deque())
            return self._changed.wait_for(lambda: len(own) < self._window, timeout_s)

    def sent(self, stream: str, stamp_ns: int) -> None:
        """One more is under way."""
        with self._changed:
            if stamp_ns + self._shift > self._done_until:
                self._under_way.setdefault(stream, deque()).append(stamp_ns + self._shift)

    def _came_out(self, data: bytes) -> None:
        with self._changed:
            self._done_until = max(self._done_until, _stamp_of(data))
            for own in self._under_way.values():
                while own and own[0] <= self._done_until:
                    own.popleft()
            self._changed.notify_all()


class SoundCredit:
    """Lets sound be ahead of skeletons by some time, as nothing is sure to come out of it.

    Once all cameras have ended, the rest of the sound goes as fast as it is taken.

    Args:
        out: topic and message whose stamps tell how far the graph has come.
        awaited: topics that end with the cameras.
        shift_ns: what is added to the stamps of the sound, which may be on another clock.
    """

    def __init__(self, node: Node, flow: Flow, out: tuple[str, str], awaited: Sequence[str], shift_ns: int):
        self._shift = shift_ns
        self._done_until: int | None = None
        self._open = {node.resolve_topic_name(topic) for topic in awaited}
        self._changed = threading.Condition()
        topic, message = out
        self._kept = [
            node.create_subscription(
                message_class(message), topic, self._came_out, collecting_quality(flow), raw=True
            ),
            node.create_subscription(message_class(END_KIND), TOPIC, self._ended, END_OF_STREAM),
        ]

    def wait(self, stamp_ns: int, timeout_s: float) -> bool:
        """Wait until sound of that stamp may be sent; False if the time ran out."""
        with self._changed:
            if self._done_until is None:
                self._done_until = stamp_ns + self._shift
            return self._changed.wait_for(lambda: self._may(stamp_ns + self._shift), timeout_s)

    def _may(self, time_ns: int) -> bool:
        return not self._open or self._done_until is None or time_ns <= self._done_until + AHEAD_NS

    def _came_out(self, data: bytes) -> None:
        with self._changed:
            self._done_until = max(self._done_until or 0, _stamp_of(data))
            self._changed.notify_all()

    def _ended(self, message: Any) -> None:
        with self._changed:
            self._open.discard(message.topic)
            self._changed.notify_all()


def _stamp_of(data: bytes) -> int:
    """The stamp that stands first in a message, behind the CDR header."""
    seconds, nanoseconds = struct.unpack_from("<iI", data, 4)
    return int(seconds) * 1_000_000_000 + int(nanoseconds)
