"""Node that publishes score maps as images, for cameras with a subscriber."""

from __future__ import annotations

from functools import partial
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile

from panoptic_ros.errors import DataError, PanopticError
from panoptic_ros.graph.topics import TOPICS, ros_name
from panoptic_ros.io.messages import from_message
from panoptic_ros.io.messages.images import heat_map_message
from panoptic_ros.nodes.middleware.family import message_class, ros_messages
from panoptic_ros.nodes.middleware.quality import LATCHED

LOOK_S = 0.5  # period of the check for subscribers


class HeatMapsNode(Node):
    """Node that publishes `/<camera>/heat_map`.

    A map holds the largest score of all joints, or the score of the joint that the parameter `joint` names.
    The node reads the detections of a camera only while the map has a subscriber.
    """

    fault = None
    healthy = True

    def __init__(self) -> None:
        super().__init__("heat_maps")
        self._joint = str(self.declare_parameter("joint", "").value)
        self._index = -1
        self._publishers_by_camera: dict[str, Any] = {}
        self._reading: dict[str, Any] = {}
        self._kept = [
            self._latched("rig", self._take_rig),
            self._latched("skeleton_model", self._take_skeleton),
        ]
        self._timer = self.create_timer(LOOK_S, self._look)

    def close(self) -> None:
        """Do nothing: the node has no threads."""

    @property
    def cameras(self) -> tuple[str, ...]:
        """Return the cameras whose detections are currently read."""
        return tuple(self._reading)

    def _latched(self, key: str, take: Any) -> Any:
        topic = TOPICS[key]

        def read(message: Any) -> None:
            try:
                take(from_message(message, topic.record))
            except PanopticError as error:
                self.get_logger().warning(f"dropped: {error}", throttle_duration_sec=5.0)

        return self.create_subscription(message_class(topic.message), topic.name, read, LATCHED)

    def _take_rig(self, rig: Any) -> None:
        kind = message_class("sensor_msgs/msg/Image")
        for name in rig.names:
            if name not in self._publishers_by_camera:
                topic = f"{ros_name(name)}/heat_map"
                self._publishers_by_camera[name] = self.create_publisher(kind, topic, QoSProfile(depth=2))

    def _take_skeleton(self, skeleton: Any) -> None:
        if self._joint and self._joint not in skeleton.joint_names:
            there = ", ".join(skeleton.joint_names)
            self.get_logger().error(f"there is no joint {self._joint!r}; all are shown; there are {there}")
        self._index = skeleton.joint_names.index(self._joint) if self._joint in skeleton.joint_names else -1

    def _look(self) -> None:
        topic = TOPICS["detections"]
        for name, publisher in self._publishers_by_camera.items():
            wanted = publisher.get_subscription_count() > 0
            if wanted and name not in self._reading:
                take = partial(self._take, name)
                self._reading[name] = self.create_subscription(
                    message_class(topic.message), topic.of(name), take, QoSProfile(depth=2)
                )
            elif not wanted and name in self._reading:
                self.destroy_subscription(self._reading.pop(name))

    def _take(self, name: str, message: Any) -> None:
        try:
            view = from_message(message, "ViewDetections")
        except DataError as error:
            self.get_logger().warning(f"dropped: {error}", throttle_duration_sec=5.0)
            return
        self._publishers_by_camera[name].publish(heat_map_message(view, ros_messages(), self._index))
