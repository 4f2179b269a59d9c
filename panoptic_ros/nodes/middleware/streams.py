"""End of stream and flow control in replay.

A publisher announces how many messages it has sent on a topic, so readers detect when they have all of them.
Sources wait for the output of the graph before they send more (see `graph.flow`).
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
    """Announcer of the ends of a node's topics, and monitor of the ends of the topics that it reads.

    A stream has ended for a reader when it has received as many messages as the publisher has sent. Several
    publishers cannot share a topic in replay.

    Args:
        on_end: called with the full name of a watched topic when its stream has ended.
    """

    def __init__(self, node: Node, on_end: Callable[[str], None]):
        self._message = message_class(END_KIND)
        self._publisher = node.create_publisher(self._message, TOPIC, END_OF_STREAM)
        self._subscription = node.create_subscription(self._message, TOPIC, self._ended, END_OF_STREAM)
        self._on_end = on_end
        self._lock = threading.Lock()  # a worker thread counts messages; ends arrive on the executor
        self._expected: dict[str, int] = {}
        self._taken: dict[str, int] = {}
        self._over: set[str] = set()
        self._watched: set[str] = set()

    def watch(self, topic: str) -> None:
        """Start to count the messages of a topic (full name)."""
        with self._lock:
            self._watched.add(topic)
        self._check(topic)

    def taken(self, topic: str) -> None:
        """Count one more message of a topic."""
        with self._lock:
            self._taken[topic] = self._taken.get(topic, 0) + 1
        self._check(topic)

    def announce(self, topic: str, count: int) -> None:
        """Announce to all readers that the topic ended after `count` messages."""
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


STALL_S = 60.0  # replay: after this time without output, one more record is sent, in case a set was refused
AHEAD_NS = 60_000_000_000  # replay: 60 s by which audio may be ahead of skeletons


class Credit:
    """Flow control of a source: it limits the sent messages that have not yet come out of a later topic.

    Only the timestamps are needed. They come first in all messages, so the subscription is raw. Each stream
    of a source is counted separately, as queues are.

    Args:
        topic, message: Name and type of the later topic.
        window: Most messages of a stream that may be under way.
        shift_ns: Added to the timestamps of sent messages, which may be on another clock.
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
        """Wait until one more message of a stream may be sent; return False after the timeout."""
        with self._changed:
            own = self._under_way.setdefault(stream, deque())
            return self._changed.wait_for(lambda: len(own) < self._window, timeout_s)

    def sent(self, stream: str, stamp_ns: int) -> None:
        """Count one more message as under way."""
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
    """Flow control of audio: it may be ahead of skeletons by `AHEAD_NS`.

    Audio does not always produce output, so its messages cannot be counted. After all cameras have ended, the
    rest of the audio is sent as fast as readers take it.

    Args:
        out: Topic and message type whose timestamps give the progress of the graph.
        awaited: Topics that end with the cameras.
        shift_ns: Added to the timestamps of the audio, which may be on another clock.
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
        """Wait until audio of this timestamp may be sent; return False after the timeout."""
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
    """Return the timestamp (ns) at the beginning of a message, after the CDR header."""
    seconds, nanoseconds = struct.unpack_from("<iI", data, 4)
    return int(seconds) * 1_000_000_000 + int(nanoseconds)
