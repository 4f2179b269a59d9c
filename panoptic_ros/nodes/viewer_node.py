"""Takes messages for the viewer as they are, and only those that somebody looks at."""

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
from panoptic_ros.nodes.family import message_class
from panoptic_ros.nodes.quality import LATCHED

LOOK_S = 0.2  # whether somebody looks at other topics
QUALITY = QoSProfile(  # a publisher never waits for who looks on
    history=HistoryPolicy.KEEP_LAST, depth=4, reliability=ReliabilityPolicy.BEST_EFFORT,
    durability=DurabilityPolicy.VOLATILE,
)  # fmt: skip


class Taker(Protocol):
    """What the node feeds, e.g. `view.page.live.LiveScene`."""

    def begin(self, rig: Rig, skeleton: SkeletonModel) -> None:
        """The rig and the skeleton are known, or are others now."""

    def wanted(self) -> frozenset[str]:
        """Keys of topics that somebody looks at."""

    def take(self, key: str, owner: str, data: bytes, now_s: float, wall_ns: int) -> None:
        """CDR bytes of a topic."""

    def tell(self, name: str, status: Mapping[str, Any]) -> None:
        """What a node says of itself."""


class ViewerNode(Node):
    """Subscribes to what a taker wants, while it wants it. Messages are not decoded."""

    fault = None
    healthy = True

    def __init__(self, taker: Taker):
        super().__init__("viewer")
        self._taker = taker
        self._facts: dict[str, Any] = {}
        self._rig: Rig | None = None
        self._taken: dict[tuple[str, str], Any] = {}  # subscriptions by topic
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
        """Nothing to stop."""

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
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values}
            level = status.level[0] if isinstance(status.level, bytes) else int(status.level)
            said = {"name": status.name, "level": level, "message": status.message,
                    "owner": status.hardware_id, "values": values}  # fmt: skip
            self._taker.tell(status.name, said)

    def _look(self) -> None:
        """Subscribe to what is wanted now, and to nothing else."""
        if self._rig is None:
            return
        wanted = {
            (key, owner)
            for key in self._taker.wanted()
            for owner in (self._rig.names if TOPICS[key].scope == "camera" else ("",))
        }
        for topic in self._taken.keys() - wanted:
            self.destroy_subscription(self._taken.pop(topic))
        for key, owner in sorted(wanted - self._taken.keys()):
            self._taken[key, owner] = self.create_subscription(
                message_class(TOPICS[key].message), TOPICS[key].of(owner), partial(self._take, key, owner),
                QUALITY, raw=True,
            )  # fmt: skip

    def _take(self, key: str, owner: str, data: bytes) -> None:
        self._taker.take(key, owner, data, time.monotonic(), time.time_ns())
