"""Node that replaces cameras and detector in benchmarks.

It publishes 2D poses and records when skeletons arrive.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from rclpy.node import Node
from rclpy.serialization import deserialize_message

from panoptic_ros.domain import ViewDetections
from panoptic_ros.graph.counters import DropLog
from panoptic_ros.graph.flow import make_flow
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.messages import stamp_of, to_message
from panoptic_ros.nodes.health.diagnostics import own_statuses, values_of
from panoptic_ros.nodes.middleware.family import message_class, ros_messages
from panoptic_ros.nodes.middleware.quality import collecting_quality, data_quality


class FeedingNode(Node):
    """Node that publishes 2D poses on request.

    Args:
        on_skeletons: Called with (timestamp of the message in ns, time of arrival in ns, track ids in it).
        clock: Returns the time of a monotonic clock in ns. It is called before a message is decoded.
    """

    def __init__(
        self,
        cameras: Iterable[str],
        on_skeletons: Callable[[int, int, frozenset[int]], None],
        clock: Callable[[], int],
    ):
        super().__init__("feeder")
        self._on_skeletons, self._now = on_skeletons, clock
        self.diagnostics: dict[str, dict[str, str]] = {}
        self.drops = DropLog()
        detections, skeletons = TOPICS["detections"], TOPICS["skeletons"]
        live = make_flow("live")
        self._feeds = {
            camera: self.create_publisher(
                message_class(detections.message), detections.of(camera), data_quality(live)
            )
            for camera in cameras
        }
        self._kind = message_class(skeletons.message)
        status = message_class("diagnostic_msgs/msg/DiagnosticArray")
        self._kept = [
            self.create_subscription(
                self._kind, skeletons.name, self._take, collecting_quality(live), raw=True
            ),
            self.create_subscription(status, "/diagnostics", self._take_status, 100),
        ]

    def message_of(self, view: ViewDetections) -> Any:
        """Return the message of the 2D poses of a view; it can be published repeatedly."""
        return to_message(view, ros_messages())

    def publish(self, message: Any, stamp_ns: int, frame_number: int) -> None:
        """Publish a view with another timestamp (ns) and frame number."""
        message.header.stamp = ros_messages().header(stamp_ns, "").stamp
        message.frame_number = frame_number
        self._feeds[message.header.frame_id].publish(message)

    def _take(self, data: bytes) -> None:
        when = self._now()
        message = deserialize_message(data, self._kind)
        ids = frozenset(int(person.id) for person in message.skeletons)
        self._on_skeletons(stamp_of(message.header), when, ids)

    def _take_status(self, message: Any) -> None:
        for name, status in own_statuses(message, self.get_namespace()):
            self.diagnostics[name] = values_of(status)
            self.drops.heard(name, self.diagnostics[name], self._now())
