"""Node that passes raw messages to the viewer, only of topics that the viewer displays."""

from __future__ import annotations

import time
from collections.abc import Mapping
from functools import partial
from typing import Any, Protocol

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from panoptic_ros.domain import Rig, SkeletonModel
from panoptic_ros.errors import PanopticError
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.messages import from_message
from panoptic_ros.nodes.health.diagnostics import own_statuses, values_of
from panoptic_ros.nodes.middleware.family import message_class
from panoptic_ros.nodes.middleware.quality import LATCHED

LOOK_S = 0.1  # period of the check for other displayed topics, and of taking messages while no skeletons come
WAKING = "skeletons"
QUALITY = QoSProfile(  # publishers never wait for a viewer; the queue holds the messages between two looks
    history=HistoryPolicy.KEEP_LAST,
    depth=16,
    reliability=ReliabilityPolicy.BEST_EFFORT,
    durability=DurabilityPolicy.VOLATILE,
)


class MessageConsumer(Protocol):
    """Consumer of the messages, e.g. `view.page.live.LiveScene`."""

    def begin(self, rig: Rig, skeleton: SkeletonModel) -> None:
        """Take the rig and the skeleton; called again when one of them changes."""

    def wanted(self) -> frozenset[str]:
        """Return the keys of the topics that the viewer displays."""

    def take(self, key: str, owner: str, data: bytes, now_s: float, wall_ns: int) -> None:
        """Take a message of a topic.

        Args:
            key, owner: key of the topic, and its camera or device.
            data: CDR bytes.
            now_s, wall_ns: time of arrival on the monotonic clock and on the system clock.
        """

    def tell(self, name: str, status: Mapping[str, Any]) -> None:
        """Take the newest diagnostic status of a node."""


class ViewerNode(Node):
    """Node that subscribes to the topics that a taker wants, while it wants them, without decoding.

    Only skeletons wake the node. Skeletons are the last message of an instant, so the node then takes all
    other waiting messages, too.
    """

    fault = None
    healthy = True

    def __init__(self, taker: MessageConsumer, namespace: str = ""):
        super().__init__("viewer", namespace=namespace)
        self._taker = taker
        self._facts: dict[str, Any] = {}
        self._rig: Rig | None = None
        self._taken: dict[tuple[str, str], Any] = {}  # subscriptions by key and owner of the topic
        self._aside = Node(  # not on an executor, so its messages wake no thread
            "viewer_aside", namespace=namespace, enable_rosout=False, start_parameter_services=False
        )
        self._kept = [
            self.create_subscription(
                message_class(TOPICS[key].message), TOPICS[key].name, partial(self._take_fact, key), LATCHED
            )
            for key in ("rig", "skeleton_model")
        ]
        self._kept.append(
            self.create_subscription(
                message_class("diagnostic_msgs/msg/DiagnosticArray"), "/diagnostics", self._take_status, 100
            )
        )
        self._timer = self.create_timer(LOOK_S, self._look)

    def close(self) -> None:
        """Do nothing: the node has no threads."""

    def destroy_node(self) -> None:
        """Destroy this node and the node of the other subscriptions."""
        self._aside.destroy_node()
        super().destroy_node()

    def _take_fact(self, key: str, message: Any) -> None:
        try:
            self._facts[key] = from_message(message, TOPICS[key].record)
        except PanopticError as error:
            self.get_logger().warning(f"dropped: {error}", throttle_duration_sec=5.0)
            return
        if len(self._facts) == 2:
            self._rig = self._facts["rig"]
            self._taker.begin(self._facts["rig"], self._facts["skeleton_model"])

    def _take_status(self, message: Any) -> None:
        for name, status in own_statuses(message, self.get_namespace()):
            level = status.level[0] if isinstance(status.level, bytes) else int(status.level)
            said = {
                "name": name,
                "level": level,
                "message": status.message,
                "owner": status.hardware_id,
                "values": values_of(status),
            }
            self._taker.tell(name, said)

    def _look(self) -> None:
        """Subscribe to the wanted topics, unsubscribe from others, and take waiting messages."""
        if self._rig is None:
            return
        wanted = {
            (key, owner)
            for key in self._taker.wanted()
            for owner in (self._rig.names if TOPICS[key].scope == "camera" else ("",))
        }
        for topic in self._taken.keys() - wanted:
            self._of(topic[0]).destroy_subscription(self._taken.pop(topic))
        for key, owner in sorted(wanted - self._taken.keys()):
            self._taken[key, owner] = self._of(key).create_subscription(
                message_class(TOPICS[key].message),
                TOPICS[key].of(owner),
                self._take_skeletons,
                QUALITY,
                raw=True,
            )
        self._drain()

    def _of(self, key: str) -> Node:
        """Return the node that subscribes to a topic."""
        return self if key == WAKING else self._aside

    def _take_skeletons(self, data: bytes) -> None:
        self._drain()
        self._taker.take(WAKING, "", data, time.monotonic(), time.time_ns())

    def _drain(self) -> None:
        """Take all waiting messages of the topics that do not wake this node."""
        for (key, owner), subscription in self._taken.items():
            if key == WAKING:
                continue
            with subscription.handle:
                while (found := subscription.handle.take_message(subscription.msg_type, True)) is not None:
                    self._taker.take(key, owner, found[0], time.monotonic(), time.time_ns())
