"""What nodes tell about records that they take, besides what their stages make of them.

What sync knows of clocks, for everybody else: sensor_msgs/TimeReference and diagnostics per device.

Previews of the images that a node takes, for whoever looks on.
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


class PreviewReports:
    """Publishes previews of images on `<camera>/preview/compressed`.

    Live, only while somebody subscribes. In replay always, and kept for those who are matched late, as the
    results of a run hold them all.
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
        """None: the stage tells of its images."""
        return []

    def _publisher(self, camera: str) -> Any:
        if camera not in self._publishers:
            topic = TOPICS["preview"]
            self._publishers[camera] = self._node.create_publisher(
                message_class(topic.message), topic.of(camera), data_quality(self._flow)
            )
        return self._publishers[camera]


class Report(Protocol):
    """Takes every record of a kind."""

    def take(self, record: Any) -> None:
        """Take one."""

    def statuses(self) -> list[Any]:
        """diagnostic_msgs/DiagnosticStatus of now."""


REPORTS: Mapping[str, Callable[[Node], Report]] = {
    "ClockModel": ClockReports,
    "ViewFrame": PreviewReports,
}


def reports_of(node: Node, wiring: Wiring) -> dict[str, Report]:
    """By kind of record, for what a node takes from outside."""
    kinds = {TOPICS[port.topic].record for port in wiring.inputs}
    return {kind: make(node) for kind, make in REPORTS.items() if kind in kinds}
