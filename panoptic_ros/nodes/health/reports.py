"""Reports of a node about the records that it receives, apart from the output of its stages.

Clock models of sync are published as sensor_msgs/TimeReference and as one diagnostic status per device.
Images are published as small previews for viewers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol

import numpy as np
from rclpy.node import Node

from panoptic_ros.domain import ClockModel, ViewFrame
from panoptic_ros.graph.flow import make_flow
from panoptic_ros.graph.health import Status
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.graph.wiring import Wiring
from panoptic_ros.io.messages import to_message
from panoptic_ros.io.previews import Previews, make_preview
from panoptic_ros.nodes.health.diagnostics import status_message
from panoptic_ros.nodes.middleware.family import message_class, ros_messages
from panoptic_ros.nodes.middleware.quality import data_quality

FOREVER = 2**63 - 1
UNSURE_NS = 2e6  # 2 ms standard deviation; a less certain clock gets a warning


class ClockReports:
    """Publisher of a time reference for every clock model; keeps the newest models for diagnostics."""

    def __init__(self, node: Node):
        self._node = node
        self._publishers: dict[str, Any] = {}
        self._models: dict[str, ClockModel] = {}

    def take(self, model: ClockModel) -> None:
        """Keep a clock model and publish it as a time reference.

        The message holds a time of the device in header.stamp and the same instant on the master clock in
        time_ref.
        """
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
        """Return one diagnostic_msgs/DiagnosticStatus per device."""
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
    """Return the device time (ns) of the model's last observation, or else its reference time."""
    return model.until_ns if model.until_ns != FOREVER else model.reference_ns


class PreviewReports:
    """Publisher of image previews on `<camera>/preview/compressed`.

    In live flow it publishes only while the topic has a subscriber. In replay it always publishes and keeps
    the messages for late subscribers, because the results of a run contain all previews.
    """

    def __init__(self, node: Node):
        self._node = node
        self._flow = make_flow(node.get_parameter("flow").value, node.get_parameter("replay_window").value)
        self._previews = Previews()
        self._publishers: dict[str, Any] = {}

    def take(self, frame: ViewFrame) -> None:
        """Publish the preview of an image if it is due and wanted."""
        publisher = self._publisher(frame.camera)
        wanted = self._flow.keeps_for_late or publisher.get_subscription_count()
        if wanted and self._previews.is_due(frame.camera, frame.stamp_ns):
            publisher.publish(to_message(make_preview(frame), ros_messages()))

    def statuses(self) -> list[Any]:
        """Return no status: the stage reports on its images."""
        return []

    def _publisher(self, camera: str) -> Any:
        if camera not in self._publishers:
            topic = TOPICS["preview"]
            self._publishers[camera] = self._node.create_publisher(
                message_class(topic.message), topic.of(camera), data_quality(self._flow)
            )
        return self._publishers[camera]


class RecordReport(Protocol):
    """Receiver of all records of one class, with diagnostics for /diagnostics."""

    def take(self, record: Any) -> None:
        """Process one record."""

    def statuses(self) -> list[Any]:
        """Return the current diagnostic_msgs/DiagnosticStatus messages."""


REPORTS: Mapping[str, Callable[[Node], RecordReport]] = {
    "ClockModel": ClockReports,
    "ViewFrame": PreviewReports,
}


def reports_of(node: Node, wiring: Wiring) -> dict[str, RecordReport]:
    """Return the reports for the records that a node receives from outside, by record class name."""
    kinds = {TOPICS[port.topic].record for port in wiring.inputs}
    return {kind: make(node) for kind, make in REPORTS.items() if kind in kinds}
