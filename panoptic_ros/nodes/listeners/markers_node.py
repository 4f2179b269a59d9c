"""/skeletons as a MarkerArray for RViz and Foxglove."""

from __future__ import annotations

from rclpy.node import Node
from rclpy.qos import QoSProfile

from panoptic_ros.domain import SkeletonModel, TrackedPoseSet
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.messages.markers import marker_array
from panoptic_ros.nodes.listeners.skeletons_reader import SkeletonsReader
from panoptic_ros.nodes.middleware.family import message_class, ros_messages


class MarkersNode(Node):
    """Turns every message of /skeletons into markers, while somebody subscribes to those."""

    fault = None
    healthy = True

    def __init__(self, flow: str = "live"):
        super().__init__("markers")
        self._shown: set[int] = set()
        markers = TOPICS["markers"]
        self._publisher = self.create_publisher(
            message_class(markers.message), markers.name, QoSProfile(depth=10)
        )
        self._reader = SkeletonsReader(self, flow, self._is_wanted, self._take)

    def close(self) -> None:
        """Nothing to stop."""

    def _is_wanted(self) -> bool:
        return bool(self._publisher.get_subscription_count())

    def _take(self, poses: TrackedPoseSet, skeleton: SkeletonModel, frame_id: str) -> None:
        there = set(poses.ids.tolist())
        gone, self._shown = self._shown - there, there
        self._publisher.publish(marker_array(poses, skeleton, frame_id, gone, ros_messages()))
