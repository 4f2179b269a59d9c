"""A node in place of a whole live graph, for the viewer: publishes what it is given, and hears /skeletons."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

from rclpy.node import Node
from rclpy.serialization import deserialize_message

from panoptic_ros.graph.flow import make_flow
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.messages import stamp_of, to_message
from panoptic_ros.io.messages.family import time_ns
from panoptic_ros.nodes.family import message_class, ros_messages
from panoptic_ros.nodes.quality import collecting_quality, data_quality

Key = tuple[str, str]  # topic and owner


class ViewLoadNode(Node):
    """Publishes records as those of another moment, and notes what that takes and when skeletons arrive.

    Attributes:
        published: ms that each call of `publish` took.
        heard: stamp of all /skeletons that came back, and ms since they were published.
        sent: stamps of the skeletons that were published.
    """

    def __init__(self, owners: Mapping[str, Sequence[str]]):
        super().__init__("view_load")
        live = make_flow("live")
        self._publishers_by_key: dict[Key, Any] = {
            (key, owner): self.create_publisher(
                message_class(TOPICS[key].message), TOPICS[key].of(owner), data_quality(live)
            )
            for key, names in owners.items() for owner in names
        }  # fmt: skip
        self.published: list[float] = []
        self.heard: list[tuple[int, float]] = []
        self.sent: list[int] = []
        kind = message_class(TOPICS["skeletons"].message)

        def hear(data: bytes) -> None:
            now = time.time_ns()
            message = deserialize_message(data, kind)
            published = time_ns(message.newest_stamp)
            self.heard.append((stamp_of(message.header), 1e-6 * (now - published)))

        self._heard_by = self.create_subscription(
            kind, TOPICS["skeletons"].name, hear, collecting_quality(live), raw=True
        )

    def message_of(self, record: Any) -> Any:
        """The message of a record, to be published as often as one likes."""
        return to_message(record, ros_messages())

    def publish(self, key: str, owner: str, message: Any, stamp_ns: int, number: int) -> None:
        """Publish a message as that of an instant; previews only while somebody subscribes, as stages do.

        The newest stamp of skeletons is the moment at which they are published.
        """
        publisher = self._publishers_by_key[key, owner]
        if key == "preview" and not publisher.get_subscription_count():
            return
        message.header.stamp = ros_messages().header(stamp_ns, "").stamp
        if key == "detections":
            message.frame_number = number
        if key == "skeletons":
            message.view_frames = [number] * len(message.view_cameras)
            message.newest_stamp = ros_messages().header(time.time_ns(), "").stamp
            self.sent.append(stamp_ns)
        begun = time.perf_counter()
        publisher.publish(message)
        self.published.append(1e3 * (time.perf_counter() - begun))
