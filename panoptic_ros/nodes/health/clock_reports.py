"""What sync knows of clocks, for everybody else: sensor_msgs/TimeReference and diagnostics per device."""

from __future__ import annotations

from typing import Any

import numpy as np
from rclpy.node import Node

from panoptic_ros.domain import ClockModel
from panoptic_ros.graph.health import Status
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.nodes.health.diagnostics import status_message
from panoptic_ros.nodes.middleware.family import message_class, ros_messages

FOREVER = 2**63 - 1
UNSURE_NS = 2e6  # a clock that is less certain than that gets a warning


class ClockReports:
    """Publishes a time reference with every clock model, and keeps the newest models for diagnostics."""

    def __init__(self, node: Node):
        self._node = node
        self._publishers: dict[str, Any] = {}
        self._models: dict[str, ClockModel] = {}

    def take(self, model: ClockModel) -> None:
        """header.stamp is a time of the device, time_ref the same instant on the master clock."""
        self._models[model.device] = model
        topic = TOPICS["time_reference"]
        if model.device not in self._publishers:
            self._publishers[model.device] = self._node.create_publisher(
                message_class(topic.message), topic.of(model.device), 10
            )
        stamp = _observed(model)
        seconds, nanoseconds = divmod(max(0, int(model.master_from_device(stamp)[0])), 1_000_000_000)
        family = ros_messages()
        self._publishers[model.device].publish(
            family.make(
                topic.message,
                header=family.header(stamp, model.device),
                time_ref=family.make("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds),
                source="panoptic clock model",
            )
        )

    def statuses(self) -> list[Any]:
        """One diagnostic_msgs/DiagnosticStatus per device."""
        namespace = self._node.get_namespace()
        return [status_message(namespace, self._status(model)) for model in self._models.copy().values()]

    def _status(self, model: ClockModel) -> Status:
        stamp = _observed(model)
        master, std = model.master_from_device(stamp)
        values = {
            "offset_s": f"{(int(master) - stamp) * 1e-9:.9f}",
            "drift_ppm": f"{1e6 * model.drift:.4f}",
            "drift_std_ppm": f"{1e6 * float(np.sqrt(model.covariance[1, 1])):.4f}",
            "std_us": f"{1e-3 * std:.3f}",
            "segment": str(model.segment),
        }
        trouble = f"uncertain to {1e-6 * std:.1f} ms" if std > UNSURE_NS else ""
        return Status(f"clock of {model.device}", trouble, model.device, values)


def _observed(model: ClockModel) -> int:
    """The newest device time that the model has seen."""
    return model.until_ns if model.until_ns != FOREVER else model.reference_ns
