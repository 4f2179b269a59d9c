"""Node of the latched facts of a capture: rig, skeleton model, and static transforms if TF is installed."""

from __future__ import annotations

import time
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from panoptic_ros.domain import Camera, Rig, SkeletonModel
from panoptic_ros.errors import EnvironmentProblem
from panoptic_ros.graph.health import GraphHealth
from panoptic_ros.graph.nodes import NODES
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.messages import to_message
from panoptic_ros.io.messages.images import optical_frame
from panoptic_ros.io.messages.transforms import transform_message
from panoptic_ros.nodes.health.diagnostics import KIND, OK, TOPIC, StatusPublisher, own_statuses, values_of
from panoptic_ros.nodes.middleware.family import message_class, ros_messages
from panoptic_ros.nodes.middleware.quality import LATCHED
from panoptic_ros.nodes.stages.kept_states import StateKeeper


class StaticsNode(Node):
    """Node that publishes rig, skeleton model and, if tf2_msgs is installed, /tf_static.

    The node also keeps the states of stages and publishes the health of the whole graph on /diagnostics.

    Args:
        live: Whether a corrected rig becomes the new /rig. In replay, every process keeps its rig until the
            end, because the time of a change would depend on the machine.
    """

    fault = None
    healthy = True

    def __init__(self, rig: Rig, skeleton: SkeletonModel, name: str = "rig", live: bool = True):
        super().__init__(name)
        self._kept = [
            self._latch(key, record) for key, record in (("rig", rig), ("skeleton_model", skeleton))
        ]
        if live:
            repaired = TOPICS["repaired_rig"]
            self._kept.append(
                self.create_subscription(
                    message_class(repaired.message), repaired.name, self._kept[0].publish, LATCHED
                )
            )
        self._publish_transforms(rig)
        self._keeper = StateKeeper(self, NODES)
        self._graph = GraphHealth()
        self._status = StatusPublisher(self, lambda briefly: self._graph.statuses(time.monotonic_ns()))
        self._kept.append(self.create_subscription(message_class(KIND), TOPIC, self._take_status, 100))

    def close(self) -> None:
        """Do nothing: the node has no threads."""

    def _take_status(self, message: Any) -> None:
        now_ns = time.monotonic_ns()
        for name, status in own_statuses(message, self.get_namespace()):
            trouble = status.message if status.level != OK else ""
            self._graph.heard(name, values_of(status), trouble, now_ns)

    def _latch(self, key: str, record: Rig | SkeletonModel) -> Any:
        topic = TOPICS[key]
        publisher = self.create_publisher(message_class(topic.message), topic.name, LATCHED)
        publisher.publish(to_message(record, ros_messages()))
        return publisher

    def _publish_transforms(self, rig: Rig) -> None:
        try:
            kind = message_class("tf2_msgs/msg/TFMessage")
        except EnvironmentProblem:
            self.get_logger().debug("no /tf_static: the package tf2_msgs is not installed")
            return
        quality = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        publisher = self.create_publisher(kind, "/tf_static", quality)
        publisher.publish(kind(transforms=[_transform(camera, rig.frame_id) for camera in rig.cameras]))
        self._kept.append(publisher)


def _transform(camera: Camera, frame_id: str) -> Any:
    """Return the transform of a camera's optical frame in the world frame."""
    world_from_cam = camera.cam_from_world.inverse()
    return transform_message(ros_messages(), 0, frame_id, optical_frame(camera.name), world_from_cam)
