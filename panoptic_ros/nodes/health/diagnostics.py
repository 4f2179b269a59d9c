"""Health of a node on /diagnostics, and the names of its statuses.

Programs that read the statuses rely on these names (docs/ros.md).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from rclpy.node import Node

from panoptic_ros.graph.health import NodeHealth, Status
from panoptic_ros.nodes.middleware.family import message_class, ros_messages

OK, WARN = b"\x00", b"\x01"
KIND = "diagnostic_msgs/msg/DiagnosticArray"
TOPIC = "/diagnostics"
PREFIX = "panoptic: "
PERIOD_S = 1.0
LOOK_S = 0.25  # period of the check for changes; a change is published without waiting for PERIOD_S


def status_name(namespace: str, what: str) -> str:
    """Return the name of a status: "panoptic: sync", or "panoptic: lab/sync" in the namespace "lab"."""
    return f"{PREFIX}{namespace.strip('/')}/{what}" if namespace.strip("/") else f"{PREFIX}{what}"


def own_statuses(message: Any, namespace: str) -> Iterator[tuple[str, Any]]:
    """Yield the statuses of a DiagnosticArray that come from a graph in this namespace.

    Each comes with its name without prefix and namespace.
    """
    head = status_name(namespace, "")
    for status in message.status:
        name = status.name.removeprefix(head)
        if name != status.name and "/" not in name.split(": ")[0]:
            yield name, status


def values_of(status: Any) -> dict[str, str]:
    """Return the values of a status as text by key."""
    return {pair.key: pair.value for pair in status.values}


def status_message(namespace: str, status: Status) -> Any:
    """Return a status as a diagnostic_msgs/DiagnosticStatus."""
    family = ros_messages()
    return family.make(
        "diagnostic_msgs/msg/DiagnosticStatus",
        level=WARN if status.trouble else OK,
        name=status_name(namespace, status.name),
        message=status.trouble or "ok",
        hardware_id=status.owner or "panoptic_ros",
        values=[
            family.make("diagnostic_msgs/msg/KeyValue", key=key, value=value)
            for key, value in status.values.items()
        ],
    )


class StatusPublisher:
    """Publisher of statuses: once a second, and at once when a status turns good or bad.

    Args:
        statuses: returns the current statuses. Its argument is True if values are not needed, which saves
            work.
    """

    def __init__(self, node: Node, statuses: Callable[[bool], Iterable[Status]]):
        self._node, self._statuses = node, statuses
        self._publisher = node.create_publisher(message_class(KIND), TOPIC, 10)
        self._timer = node.create_timer(LOOK_S, self._look)
        self._due = 0.0
        self._told: dict[str, bool] = {}
        # counter of events; an increase triggers a message at once
        self.events: Callable[[], int] = lambda: 0
        self._events_told = 0
        self.more: Callable[[], list[Any]] = list  # returns further DiagnosticStatus messages

    def _look(self) -> None:
        troubled = self._troubled(self._statuses(True))
        is_new = troubled != self._told or self.events() != self._events_told
        if is_new or time.monotonic() >= self._due:
            self.publish()

    def publish(self) -> None:
        """Publish the current statuses."""
        self._events_told = self.events()
        found = list(self._statuses(False))
        self._told = self._troubled(found)
        self._due = time.monotonic() + PERIOD_S - 0.5 * LOOK_S
        messages = [status_message(self._node.get_namespace(), status) for status in found]
        header = ros_messages().header(self._node.get_clock().now().nanoseconds, "")
        self._publisher.publish(ros_messages().make(KIND, header=header, status=[*messages, *self.more()]))

    @staticmethod
    def _troubled(statuses: Iterable[Status]) -> dict[str, bool]:
        return {status.name: bool(status.trouble) for status in statuses}


class Diagnostics(StatusPublisher):
    """Publisher of the health of a node's stages and inputs.

    Args:
        look: updates the health before each publication.
    """

    def __init__(self, node: Node, health: NodeHealth, look: Callable[[], None] = lambda: None):
        self.health, self._refresh = health, look
        super().__init__(node, self._now)

    def _now(self, briefly: bool) -> list[Status]:
        self._refresh()
        return self.health.statuses(time.monotonic_ns(), briefly)

    @property
    def finished(self) -> bool:
        """Return whether the node has processed its whole input (replay)."""
        return self.health.finished

    def finish(self) -> None:
        """Mark the node as finished and publish this at once; later calls do nothing."""
        if not self.finished:
            self.health.finished = True
            self.publish()
