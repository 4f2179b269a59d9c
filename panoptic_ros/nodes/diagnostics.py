"""The statistics of a node's stages on /diagnostics."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from rclpy.node import Node

from panoptic_ros.graph.counters import StageStatistics
from panoptic_ros.nodes.family import message_class, ros_messages

OK, WARN = b"\x00", b"\x01"


class Diagnostics:
    """Publishes once a second, and once more when told so.

    Args:
        statistics: by stage. A status has the name of its stage, of the only one that of the node.
    """

    def __init__(self, node: Node, statistics: Mapping[str, StageStatistics]):
        self._node = node
        self._statistics = statistics
        kind = message_class("diagnostic_msgs/msg/DiagnosticArray")
        self._publisher = node.create_publisher(kind, "/diagnostics", 10)
        self._timer = node.create_timer(1.0, self.publish)
        self.finished = False
        self.more: Callable[[], list[Any]] = list  # further statuses

    def publish(self) -> None:
        """Publish the state of now."""
        family = ros_messages()
        only = len(self._statistics) == 1
        statuses = [
            self._status(self._node.get_name() if only else stage, own)
            for stage, own in self._statistics.items()
        ]
        header = family.header(self._node.get_clock().now().nanoseconds, "")
        self._publisher.publish(
            family.make(
                "diagnostic_msgs/msg/DiagnosticArray", header=header, status=[*statuses, *self.more()]
            )
        )

    def _status(self, name: str, statistics: StageStatistics) -> Any:
        family = ros_messages()
        values = dict(statistics.values())
        values["finished"] = str(self.finished).lower()
        dropped = sum(statistics.dropped.values())
        return family.make(
            "diagnostic_msgs/msg/DiagnosticStatus",
            level=WARN if dropped else OK,
            name=f"panoptic: {name}",
            message=f"{dropped} dropped" if dropped else "ok",
            hardware_id="panoptic_ros",
            values=[family.make("diagnostic_msgs/msg/KeyValue", key=k, value=v) for k, v in values.items()],
        )
