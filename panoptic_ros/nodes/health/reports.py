"""What nodes tell about records that they take, besides what their stages make of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol

from rclpy.node import Node

from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.graph.wiring import Wiring
from panoptic_ros.nodes.health.clock_reports import ClockReports
from panoptic_ros.nodes.health.preview_reports import PreviewReports


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
