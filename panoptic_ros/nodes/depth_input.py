"""How the detection node gets the depth maps of the cameras that have them."""
from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from rclpy.node import Node
from rclpy.parameter import Parameter

from panoptic_ros.graph.depth_pairing import DepthPairing, Pair
from panoptic_ros.graph.flow import Flow
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.messages import stamp_of
from panoptic_ros.nodes.family import message_class
from panoptic_ros.nodes.quality import data_quality
from panoptic_ros.nodes.streams import StreamEnds

PARAMETERS = {"depths": "depth", "compressed_depths": "compressed_depth"}  # and the topic that each means
PATIENCE_NS = 200_000_000  # live: by so much, in stamps, an image waits for its depth map


class DepthInput:
    """Images go through it: those of cameras that have depth maps wait for them.

    The node's parameter `depths` names the cameras whose maps come as images, `compressed_depths` those
    whose maps come as compressedDepth.

    All calls come on the executor's thread.

    Args:
        put: takes every image with its depth map, if it has one.
    """

    def __init__(self, node: Node, flow: Flow, put: Callable[[Pair], None]):
        self._kinds = {
            camera: key for parameter, key in PARAMETERS.items()
            for camera in node.declare_parameter(parameter, Parameter.Type.STRING_ARRAY).value or []
        }  # fmt: skip
        self._node, self._flow, self._put = node, flow, put
        self._pairing = DepthPairing(self._kinds, None if flow.name == "replay" else PATIENCE_NS)
        self._topics: dict[str, str] = {}  # full name -> camera
        self._subscriptions: list[Any] = []

    def listen(self, cameras: Iterable[str], ends: StreamEnds) -> None:
        """Subscribe to the depth maps of those of the cameras that have them."""
        for camera in self._pairing.cameras & set(cameras):
            self._listen(camera, ends)

    def take_image(self, camera: str, message: Any) -> None:
        """An image has come."""
        self._put_all(self._pairing.image(camera, stamp_of(message.header), message))

    def over(self, topic: str) -> bool:
        """A topic has come to its end; whether it is one of depth maps."""
        if topic not in self._topics:
            return False
        self._put_all(self._pairing.end(self._topics[topic]))
        return True

    def _listen(self, camera: str, ends: StreamEnds) -> None:
        def receive(message: Any) -> None:
            self._put_all(self._pairing.depth(camera, stamp_of(message.header), message))
            ends.taken(name)

        topic, quality = TOPICS[self._kinds[camera]], data_quality(self._flow, images=True)
        subscription = self._node.create_subscription(
            message_class(topic.message), topic.of(camera), receive, quality
        )
        name = subscription.topic_name
        self._subscriptions.append(subscription)
        self._topics[name] = camera
        ends.watch(name)

    def _put_all(self, pairs: list[Pair]) -> None:
        for pair in pairs:
            self._put(pair)
