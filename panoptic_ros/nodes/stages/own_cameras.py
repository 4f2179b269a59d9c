"""Cameras that a node reads itself: their images go to its stages as they are.

Messages are made of them only for those who subscribe.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rclpy.node import Node

from panoptic_ros.domain import DepthFrame, Rig, ViewFrame
from panoptic_ros.graph.arrivals import Arrivals
from panoptic_ros.graph.flow import Flow
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.messages import (
    camera_info_message,
    compressed_image_message,
    depth_message,
    image_message,
)
from panoptic_ros.nodes.middleware.family import message_class, ros_messages
from panoptic_ros.nodes.middleware.quality import data_quality
from panoptic_ros.nodes.stages.inputs import Input


@dataclass(frozen=True)
class OwnCameras:
    """The cameras that a node reads itself.

    Args:
        sources: descriptions by camera, see `capture.open_source`.
        threads: images that are worked on at a time.
        jpeg_quality: of images that are sent; 0: as they are.
    """

    sources: Mapping[str, Mapping[str, Any]]
    threads: int = 1
    jpeg_quality: int = 0


class OwnInput(Input):
    """An input whose records come as they are."""

    def record(self, data: Any) -> Any:
        """The record."""
        return data

    def missing_before(self, record: Any) -> int:
        """None: `came` has counted them."""
        return 0

    def came(self, frame: ViewFrame, latency_ns: int | None) -> int:
        """An image was read, so long after its stamp (live); how many before it nobody read."""
        self.arrivals.came(time.monotonic_ns(), None, latency_ns)
        return self.arrivals.numbered(frame.frame_number)


def own_input(node: Node, topic: str, camera: str) -> OwnInput:
    """The input of a topic of a camera that the node reads itself."""
    row = TOPICS[topic]
    name = node.resolve_topic_name(row.of(camera))
    arrivals = Arrivals(topic, camera, name, topic == "image", time.monotonic_ns())
    kind = message_class(row.message)
    return OwnInput(topic, topic, camera, name, kind, lambda message, number: message, arrivals)


class ImagesSent:
    """Sends images, camera infos and depth maps of some cameras to those who subscribe."""

    def __init__(self, node: Node, flow: Flow, rig: Rig, own: OwnCameras):
        self._rig, self._quality = rig, own.jpeg_quality
        self._image = "compressed_image" if own.jpeg_quality else "image"
        images = data_quality(flow, images=True)
        self._publishers = {
            (key, camera): node.create_publisher(
                message_class(TOPICS[key].message), TOPICS[key].of(camera), images
            )
            for camera in own.sources
            for key in (self._image, "camera_info", "depth")
        }

    def send(self, record: ViewFrame | DepthFrame) -> None:
        """Send a record, if somebody subscribes."""
        family, camera = ros_messages(), record.camera
        if isinstance(record, DepthFrame):
            if self._is_wanted("depth", camera):
                self._publishers["depth", camera].publish(depth_message(record, family))
            return
        if self._is_wanted("camera_info", camera):
            info = camera_info_message(self._rig.camera(camera), record.stamp_ns, family)
            self._publishers["camera_info", camera].publish(info)
        if self._is_wanted(self._image, camera):
            message = (
                compressed_image_message(record, family, self._quality)
                if self._quality
                else image_message(record, family)
            )
            self._publishers[self._image, camera].publish(message)

    def _is_wanted(self, key: str, camera: str) -> bool:
        return self._publishers[key, camera].get_subscription_count() > 0
