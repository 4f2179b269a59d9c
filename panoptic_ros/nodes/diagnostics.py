"""A node's statistics on /diagnostics."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node

from panoptic_ros.graph.counters import StageStatistics
from panoptic_ros.nodes.family import message_class, ros_messages

PATIENCE_S = 5.0  # a first step that takes longer compiles kernels
OK, WARN = b"\x00", b"\x01"


class Diagnostics:
    """Publishes once a second, and once more when told so."""

    def __init__(self, node: Node, statistics: StageStatistics):
        self._node = node
        self._statistics = statistics
        kind = message_class("diagnostic_msgs/msg/DiagnosticArray")
        self._publisher = node.create_publisher(kind, "/diagnostics", 10)
        self._timer = node.create_timer(1.0, self.publish)
        self.finished = False
        self.more: Callable[[], list[Any]] = list  # further statuses
        self.busy_s: Callable[[], float] = float  # how long the step at hand has taken so far
        self._explained = False

    def publish(self) -> None:
        """Publish the state of now."""
        self._explain()
        family = ros_messages()
        values = dict(self._statistics.values())
        values["finished"] = str(self.finished).lower()
        dropped = sum(self._statistics.dropped.values())
        status = family.make(
            "diagnostic_msgs/msg/DiagnosticStatus",
            level=WARN if dropped else OK,
            name=f"panoptic: {self._node.get_name()}",
            message=f"{dropped} dropped" if dropped else "ok",
            hardware_id="panoptic_ros",
            values=[family.make("diagnostic_msgs/msg/KeyValue", key=k, value=v) for k, v in values.items()],
        )
        header = family.header(self._node.get_clock().now().nanoseconds, "")
        self._publisher.publish(
            family.make("diagnostic_msgs/msg/DiagnosticArray", header=header, status=[status, *self.more()])
        )

    def _explain(self) -> None:
        """Say why nothing comes, once, if the first step takes long."""
        if not self._explained and not self._statistics.taken and self.busy_s() > PATIENCE_S:
            self._explained = True
            self._node.get_logger().info(
                "the first message compiles kernels, which takes about a minute and is done once per "
                "installation; what comes meanwhile is dropped in live flow"
            )
