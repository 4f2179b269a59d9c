"""Node that only listens: it collects the diagnostics of all graphs in this ROS domain."""

from __future__ import annotations

import time
from typing import Any

from rclpy.node import Node

from panoptic_ros.graph.health import ReceivedStatus
from panoptic_ros.nodes.health.diagnostics import KIND, OK, PREFIX, TOPIC, values_of
from panoptic_ros.nodes.middleware.family import message_class


class WatchNode(Node):
    """Node that keeps the newest status of every name."""

    def __init__(self) -> None:
        super().__init__("panoptic_watch", enable_rosout=False, start_parameter_services=False)
        self.told: dict[str, ReceivedStatus] = {}  # by full name, without the prefix
        self._kept = self.create_subscription(message_class(KIND), TOPIC, self._take, 100)

    def _take(self, message: Any) -> None:
        now_s = time.monotonic()
        for status in message.status:
            if status.name.startswith(PREFIX):
                full = status.name.removeprefix(PREFIX)
                head, colon, rest = full.partition(": ")
                namespace, _, node = head.rpartition("/")
                trouble = status.message if status.level != OK else ""
                self.told[full] = ReceivedStatus(
                    namespace, node + colon + rest, trouble, values_of(status), now_s
                )
