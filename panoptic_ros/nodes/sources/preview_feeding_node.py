"""Node that replaces cameras in the benchmark of the viewer.

It publishes previews and records when the graph published skeletons.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from rclpy.node import Node
from rclpy.serialization import deserialize_message

from panoptic_ros.domain import Preview
from panoptic_ros.graph.flow import make_flow
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.messages import stamp_of, to_message
from panoptic_ros.nodes.middleware.family import message_class, ros_messages
from panoptic_ros.nodes.middleware.quality import collecting_quality, data_quality
from panoptic_ros.nodes.middleware.runtime import with_facts


class PreviewFeedingNode(Node):
    """Node that publishes previews while they have a subscriber, as stage nodes do.

    Attributes:
        published: time of publication (ns) by timestamp (ns) of all received /skeletons.
    """

    def __init__(self, cameras: Iterable[str]):
        super().__init__("preview_feeder")
        live, preview, skeletons = make_flow("live"), TOPICS["preview"], TOPICS["skeletons"]
        self.published: dict[int, int] = {}
        self._publishers_by_camera = {
            name: self.create_publisher(message_class(preview.message), preview.of(name), data_quality(live))
            for name in cameras
        }

        kind = message_class(skeletons.message)

        def hear(data: bytes, facts: Mapping[str, Any]) -> None:
            stamp = stamp_of(deserialize_message(data, kind).header)
            self.published[stamp] = int(facts["source_timestamp"])

        self._heard_by = self.create_subscription(
            kind, skeletons.name, with_facts(hear), collecting_quality(live), raw=True
        )

    def message_of(self, preview: Preview) -> Any:
        """Return the message of a preview; it can be published repeatedly."""
        return to_message(preview, ros_messages())

    def publish(self, camera: str, message: Any, stamp_ns: int) -> None:
        """Publish a preview with another timestamp (ns), if it has a subscriber."""
        publisher = self._publishers_by_camera[camera]
        if publisher.get_subscription_count():
            message.header.stamp = ros_messages().header(stamp_ns, "").stamp
            publisher.publish(message)
