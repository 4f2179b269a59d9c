"""How a source in replay waits for what comes out (see `graph.flow`)."""
from __future__ import annotations

import struct
import threading
from collections import deque

from rclpy.node import Node

from panoptic_ros.graph.flow import Flow
from panoptic_ros.nodes.family import message_class
from panoptic_ros.nodes.quality import collecting_quality


class Credit:
    """Counts what a source has sent and has not yet seen come out of a topic further down.

    Needs the stamps of the messages only, which stand first in all of them, so it takes them raw.
    """

    def __init__(self, node: Node, flow: Flow, topic: str, message: str, window: int):
        self._window = window
        self._under_way: deque[int] = deque()
        self._done_until = -1
        self._changed = threading.Condition()
        self._subscription = node.create_subscription(
            message_class(message), topic, self._came_out, collecting_quality(flow), raw=True
        )

    def wait(self, timeout_s: float) -> bool:
        """Wait until one more may be sent; False if the time ran out."""
        with self._changed:
            return self._changed.wait_for(lambda: len(self._under_way) < self._window, timeout_s)

    def sent(self, stamp_ns: int) -> None:
        """One more is under way."""
        with self._changed:
            if stamp_ns > self._done_until:
                self._under_way.append(stamp_ns)

    def _came_out(self, data: bytes) -> None:
        seconds, nanoseconds = struct.unpack_from("<iI", data, 4)  # behind the CDR header
        with self._changed:
            self._done_until = max(self._done_until, seconds * 1_000_000_000 + nanoseconds)
            while self._under_way and self._under_way[0] <= self._done_until:
                self._under_way.popleft()
            self._changed.notify_all()
