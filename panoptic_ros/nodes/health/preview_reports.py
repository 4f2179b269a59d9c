"""Previews of the images that a node takes, for whoever looks on."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node

from panoptic_ros.domain import ViewFrame
from panoptic_ros.graph.flow import make_flow
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.messages import to_message
from panoptic_ros.io.previews import Previews, make_preview
from panoptic_ros.nodes.middleware.family import message_class, ros_messages
from panoptic_ros.nodes.middleware.quality import data_quality


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
