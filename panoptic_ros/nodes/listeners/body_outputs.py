"""/bodies as joint angles with their URDF, as REP 155 has them, and as TF of segments."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.parameter import Parameter

from panoptic_ros.domain import BodyStateSet
from panoptic_ros.errors import DataError, EnvironmentProblem
from panoptic_ros.export.body_json import hello_text, instant_text
from panoptic_ros.export.body_socket import BodySocket
from panoptic_ros.export.urdf import urdf_text
from panoptic_ros.graph.flow import make_flow
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.body_models import read_body_model, read_body_shape
from panoptic_ros.io.colors import rgb_of
from panoptic_ros.io.messages import from_message
from panoptic_ros.io.messages.people import body_name, joint_state_message, segment_transforms
from panoptic_ros.nodes.middleware.family import message_class, ros_messages
from panoptic_ros.nodes.middleware.packets import unpacked
from panoptic_ros.nodes.middleware.quality import LATCHED, collecting_quality

Array = np.ndarray
PORT = 8770  # of the stream
CHANGED_M = 0.001  # of a length, from which a body is described anew
JOINTS, DESCRIPTION = "/humans/bodies/{}/joint_states", "/humans/bodies/{}/urdf"


class _Described:
    """What is published of one body: its publishers, and the lengths that its description has."""

    def __init__(self, node: Node, body: str):
        self.joints = node.create_publisher(
            message_class("sensor_msgs/msg/JointState"), JOINTS.format(body), 10
        )
        self.description = node.create_publisher(
            message_class("std_msgs/msg/String"), DESCRIPTION.format(body), LATCHED
        )
        self.offsets: Array | None = None


class BodyOutputs:
    """Says /bodies in other words for a node.

    "joints": `/humans/bodies/<id>/joint_states` and, latched, `/humans/bodies/<id>/urdf`; the description is
    also the node's parameter `human_description_<id>`, as packages for REP 155 look for it. "segments": /tf.
    "stream": JSON over a WebSocket, see `export.body_json`, at the node's parameters `stream_host` and
    `stream_port`.

    Args:
        words: which of these. segments: skeleton, as `kinematics.segments`. prefix: before frames in TF.

    Raises:
        DataError: if there is no such skeleton.
        EnvironmentProblem: if nothing can listen at that port.
    """

    def __init__(self, node: Node, flow: str, words: Sequence[str], segments: str, prefix: str):
        self._node, self._words, self._prefix = node, tuple(words), prefix
        self._model = read_body_model(segments)
        self._shape = read_body_shape(self._model)
        self._bodies: dict[int, _Described] = {}
        self._transforms = self._publisher_of_tf() if "segments" in words else None
        self.framed: frozenset[int] = frozenset()  # ids whose frame body_<id> is said here
        self._socket = self._open_socket() if "stream" in words else None
        topic = TOPICS["bodies"]
        self._kind = message_class(topic.message)
        quality = collecting_quality(make_flow(flow))
        self._kept = node.create_subscription(self._kind, topic.name, self._take, quality, raw=True)

    def close(self) -> None:
        """Send nothing any more."""
        if self._socket is not None:
            self._socket.close()

    def _open_socket(self) -> BodySocket:
        host = str(self._node.declare_parameter("stream_host", "127.0.0.1").value)
        socket = BodySocket(host, int(self._node.declare_parameter("stream_port", PORT).value))
        self._node.get_logger().info(f"bodies as JSON at {socket.address}")
        return socket

    def _publisher_of_tf(self) -> Any:
        try:
            return self._node.create_publisher(message_class("tf2_msgs/msg/TFMessage"), "/tf", 100)
        except EnvironmentProblem:
            self._node.get_logger().info("no /tf: the package tf2_msgs is not installed here")
            return None

    def _take(self, data: bytes) -> None:
        try:
            message = unpacked(data, self._kind)
            item = from_message(message, "BodyStateSet")
            if item.segment_names != self._model.names:
                raise DataError("bodies of other segments than the parameter `segments` says")
        except DataError as error:
            self._node.get_logger().warning(f"dropped: {error}", throttle_duration_sec=5.0)
            return
        if self._socket is not None and self._socket.watched:
            self._socket.begin(hello_text(self._model, message.header.frame_id))
            self._socket.offer(instant_text(item, self._model))
        if "joints" in self._words:
            for k, number in enumerate(item.ids.tolist()):
                self._publish_joints(item, k, number)
        if self._transforms is not None:
            self.framed = frozenset(item.ids.tolist())
            if self._transforms.get_subscription_count():
                family = ros_messages()
                frame_id = message.header.frame_id
                rows = segment_transforms(item, self._model, frame_id, self._prefix, family)
                self._transforms.publish(family.make("tf2_msgs/msg/TFMessage", transforms=rows))

    def _publish_joints(self, item: BodyStateSet, k: int, number: int) -> None:
        own = self._bodies.get(number)
        if own is None:
            own = self._bodies[number] = _Described(self._node, body_name(number))
        if own.offsets is None or np.abs(item.offsets[k] - own.offsets).max() > CHANGED_M:
            own.offsets = item.offsets[k]
            self._describe(own, number)
        if own.joints.get_subscription_count():
            own.joints.publish(joint_state_message(item, k, self._model, ros_messages()))

    def _describe(self, own: _Described, number: int) -> None:
        body = body_name(number)
        assert own.offsets is not None
        text = urdf_text(self._shape, own.offsets, body, rgb_of(number))
        own.description.publish(ros_messages().make("std_msgs/msg/String", data=text))
        name = f"human_description_{body}"
        if not self._node.has_parameter(name):
            self._node.declare_parameter(name, text)
        else:
            self._node.set_parameters([Parameter(name, value=text)])
