"""How a node is, on /diagnostics; the names of statuses, for those who read them (docs/ros.md)."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from rclpy.node import Node

from panoptic_ros.graph.health import Health, Status
from panoptic_ros.nodes.middleware.family import message_class, ros_messages

OK, WARN = b"\x00", b"\x01"
KIND = "diagnostic_msgs/msg/DiagnosticArray"
TOPIC = "/diagnostics"
PREFIX = "panoptic: "
PERIOD_S = 1.0
LOOK_S = 0.25  # whether something has changed, which is told at once


def status_name(namespace: str, what: str) -> str:
    """The name of a status: "panoptic: sync", in a namespace "panoptic: lab/sync"."""
    return f"{PREFIX}{namespace.strip('/')}/{what}" if namespace.strip("/") else f"{PREFIX}{what}"


def own_statuses(message: Any, namespace: str) -> Iterator[tuple[str, Any]]:
    """Those of a DiagnosticArray that a graph in this namespace gave, each with its name there."""
    head = status_name(namespace, "")
    for status in message.status:
        name = status.name.removeprefix(head)
        if name != status.name and "/" not in name.split(": ")[0]:
            yield name, status


def values_of(status: Any) -> dict[str, str]:
    """The values of a status by key."""
    return {pair.key: pair.value for pair in status.values}


def status_message(namespace: str, status: Status) -> Any:
    """A diagnostic_msgs/DiagnosticStatus."""
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
    """Publishes statuses once a second, and at once when one of them turns good or bad.

    Args:
        statuses: told whether they may lack their values, which are not looked at then.
    """

    def __init__(self, node: Node, statuses: Callable[[bool], Iterable[Status]]):
        self._node, self._statuses = node, statuses
        self._publisher = node.create_publisher(message_class(KIND), TOPIC, 10)
        self._timer = node.create_timer(LOOK_S, self._look)
        self._due = 0.0
        self._told: dict[str, bool] = {}
        self.events: Callable[[], int] = lambda: 0  # goes up when there is something new to tell at once
        self._events_told = 0
        self.more: Callable[[], list[Any]] = list  # further DiagnosticStatus messages

    def _look(self) -> None:
        troubled = self._troubled(self._statuses(True))
        is_new = troubled != self._told or self.events() != self._events_told
        if is_new or time.monotonic() >= self._due:
            self.publish()

    def publish(self) -> None:
        """Publish the state of now."""
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
    """The health of a node's stages and inputs.

    Args:
        look: brings the health up to date.
    """

    def __init__(self, node: Node, health: Health, look: Callable[[], None] = lambda: None):
        self.health, self._refresh = health, look
        super().__init__(node, self._now)

    def _now(self, briefly: bool) -> list[Status]:
        self._refresh()
        return self.health.statuses(time.monotonic_ns(), briefly)

    @property
    def finished(self) -> bool:
        """Whether the node is through (replay)."""
        return self.health.finished

    def finish(self) -> None:
        """The node is through: tell at once, and once."""
        if not self.finished:
            self.health.finished = True
            self.publish()
