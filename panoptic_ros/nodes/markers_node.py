"""/skeletons as a MarkerArray for RViz and Foxglove."""
from __future__ import annotations

from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message

from panoptic_ros.domain import SkeletonModel
from panoptic_ros.errors import DataError, PanopticError
from panoptic_ros.graph.flow import make_flow
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.messages import from_message
from panoptic_ros.io.messages.markers import marker_array
from panoptic_ros.nodes.family import message_class, ros_messages
from panoptic_ros.nodes.quality import LATCHED, collecting_quality


class MarkersNode(Node):
    """Turns every message of /skeletons into markers, while somebody subscribes to those."""

    fault = None
    healthy = True

    def __init__(self, flow: str = "live"):
        super().__init__("markers")
        self._skeleton: SkeletonModel | None = None
        skeletons, model, markers = TOPICS["skeletons"], TOPICS["skeleton_model"], TOPICS["markers"]
        self._shown: set[int] = set()
        self._publisher = self.create_publisher(
            message_class(markers.message), markers.name, QoSProfile(depth=10)
        )
        self._kind = message_class(skeletons.message)
        self._kept = [
            self.create_subscription(message_class(model.message), model.name, self._take_model, LATCHED),
            self.create_subscription(
                self._kind, skeletons.name, self._take, collecting_quality(make_flow(flow)), raw=True
            ),
        ]  # fmt: skip

    def close(self) -> None:
        """Nothing to stop."""

    def _take_model(self, message: Any) -> None:
        try:
            self._skeleton = from_message(message, "SkeletonModel")
        except PanopticError as error:
            self.get_logger().warning(f"dropped: {error}", throttle_duration_sec=5.0)

    def _take(self, data: bytes) -> None:
        if self._skeleton is None or not self._publisher.get_subscription_count():
            return
        message = deserialize_message(data, self._kind)
        try:
            poses = from_message(message, "RefinedPoseSet")
            if poses.skeleton_hash != self._skeleton.hash:
                raise DataError(
                    f"skeletons of model {poses.skeleton_hash}, but /skeleton_model is {self._skeleton.hash}"
                )
        except DataError as error:
            self.get_logger().warning(f"dropped: {error}", throttle_duration_sec=5.0)
            return
        gone = self._shown - set(poses.ids.tolist())
        self._shown = set(poses.ids.tolist())
        self._publisher.publish(
            marker_array(poses, self._skeleton, message.header.frame_id, gone, ros_messages())
        )
