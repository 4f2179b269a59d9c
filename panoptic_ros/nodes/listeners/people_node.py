"""Nodes that convert /skeletons and /bodies into messages of other packages.

Skeletons become roots, TF, REP-155 bodies and boxes, or a MarkerArray for RViz and Foxglove. Bodies become
joint angles with a URDF (REP 155), TF of segments, or a JSON stream.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile

from panoptic_ros.domain import BodyStateSet, SkeletonModel, TrackedPoseSet
from panoptic_ros.errors import ConfigError, DataError, EnvironmentProblem, PanopticError
from panoptic_ros.export.body_json import hello_text, instant_text
from panoptic_ros.export.body_socket import BodySocket
from panoptic_ros.export.urdf import urdf_text
from panoptic_ros.graph.counters import StageStatistics
from panoptic_ros.graph.flow import make_flow
from panoptic_ros.graph.health import NodeHealth
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.body_models import DEFAULT_MODEL, read_body_model, read_body_shape
from panoptic_ros.io.colors import rgb_of
from panoptic_ros.io.messages import from_message
from panoptic_ros.io.messages.markers import marker_array
from panoptic_ros.io.messages.people import (
    bodies_message,
    body_name,
    boxes_message,
    joint_state_message,
    joint_transforms,
    roots_message,
    segment_transforms,
)
from panoptic_ros.nodes.health.diagnostics import Diagnostics
from panoptic_ros.nodes.middleware.family import message_class, ros_messages
from panoptic_ros.nodes.middleware.packets import unpacked
from panoptic_ros.nodes.middleware.quality import LATCHED, collecting_quality

# (tracked 3D poses, their skeleton, the world frame_id)
Take = Callable[[TrackedPoseSet, SkeletonModel, str], None]
Array = np.ndarray
PORT = 8770  # TCP port of the JSON stream
CHANGED_M = 0.001  # m; if a bone offset changes by more, the URDF is published again
JOINTS, DESCRIPTION = "/humans/bodies/{}/joint_states", "/humans/bodies/{}/urdf"


class _BodyPublishers:
    """Publishers of one body, and the bone offsets (m) of its published description."""

    def __init__(self, node: Node, body: str):
        self.joints = node.create_publisher(
            message_class("sensor_msgs/msg/JointState"), JOINTS.format(body), 10
        )
        self.description = node.create_publisher(
            message_class("std_msgs/msg/String"), DESCRIPTION.format(body), LATCHED
        )
        self.offsets: Array | None = None


class BodyOutputs:
    """Converter of /bodies into other formats, for a node.

    "joints": `/humans/bodies/<id>/joint_states` and, latched, `/humans/bodies/<id>/urdf`. The description is
    also the node's parameter `human_description_<id>`, where packages for REP 155 look for it.
    "segments": /tf.
    "stream": JSON over a WebSocket, see `export.body_json`, at the node's parameters `stream_host` and
    `stream_port`.

    Args:
        words: the selected formats.
        segments: body model, as in the parameter `kinematics.segments`.
        prefix: of TF frame names.

    Raises:
        DataError: if there is no such body model.
        EnvironmentProblem: if the port cannot be opened.
    """

    def __init__(self, node: Node, flow: str, words: Sequence[str], segments: str, prefix: str):
        self._node, self._words, self._prefix = node, tuple(words), prefix
        self._model = read_body_model(segments)
        self._shape = read_body_shape(self._model)
        self._bodies: dict[int, _BodyPublishers] = {}
        self._transforms = self._publisher_of_tf() if "segments" in words else None
        self.framed: frozenset[int] = frozenset()  # ids whose frame body_<id> is published here
        self._socket = self._open_socket() if "stream" in words else None
        topic = TOPICS["bodies"]
        self._kind = message_class(topic.message)
        quality = collecting_quality(make_flow(flow))
        self._kept = node.create_subscription(self._kind, topic.name, self._take, quality, raw=True)

    def close(self) -> None:
        """Close the JSON stream."""
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
                raise DataError("bodies of other segments than those of the parameter `segments`")
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
            own = self._bodies[number] = _BodyPublishers(self._node, body_name(number))
        if own.offsets is None or np.abs(item.offsets[k] - own.offsets).max() > CHANGED_M:
            own.offsets = item.offsets[k]
            self._describe(own, number)
        if own.joints.get_subscription_count():
            own.joints.publish(joint_state_message(item, k, self._model, ros_messages()))

    def _describe(self, own: _BodyPublishers, number: int) -> None:
        body = body_name(number)
        assert own.offsets is not None
        text = urdf_text(self._shape, own.offsets, body, rgb_of(number))
        own.description.publish(ros_messages().make("std_msgs/msg/String", data=text))
        name = f"human_description_{body}"
        if not self._node.has_parameter(name):
            self._node.declare_parameter(name, text)
        else:
            self._node.set_parameters([Parameter(name, value=text)])


class SkeletonsReader:
    """Reader of /skeletons for a node, with diagnostics; it decodes messages only while the output is wanted.

    Args:
        wanted: returns whether to decode the next message.
        take: called with the decoded 3D poses.
    """

    def __init__(self, node: Node, flow: str, wanted: Callable[[], bool], take: Take):
        self._node, self._wanted, self._take = node, wanted, take
        self._skeleton: SkeletonModel | None = None
        self.statistics = StageStatistics()
        name = node.get_name()
        self._health = NodeHealth(name, {name: self.statistics}, live=flow == "live")
        self._diagnostics = Diagnostics(node, self._health, self._look)
        skeletons, model = TOPICS["skeletons"], TOPICS["skeleton_model"]
        self._kind = message_class(skeletons.message)
        quality = collecting_quality(make_flow(flow))
        self._kept = [
            node.create_subscription(message_class(model.message), model.name, self._take_model, LATCHED),
            node.create_subscription(self._kind, skeletons.name, self._take_people, quality, raw=True),
        ]

    def _look(self) -> None:
        self._health.awaited = () if self._skeleton is not None else ("skeleton_model",)

    def _take_model(self, message: Any) -> None:
        try:
            self._skeleton = from_message(message, "SkeletonModel")
        except PanopticError as error:
            self._node.get_logger().warning(f"dropped: {error}", throttle_duration_sec=5.0)

    def _take_people(self, data: bytes) -> None:
        if self._skeleton is None or not self._wanted():
            return
        begun_ns = time.monotonic_ns()
        try:
            message = unpacked(data, self._kind)
            poses = from_message(message, "RefinedPoseSet")
            if poses.skeleton_hash != self._skeleton.hash:
                raise DataError(
                    f"skeletons of model {poses.skeleton_hash}, but /skeleton_model is {self._skeleton.hash}"
                )
        except DataError as error:
            self.statistics.dropped["bad_message"] += 1
            self._node.get_logger().warning(f"dropped: {error}", throttle_duration_sec=5.0)
            return
        self._take(poses, self._skeleton, message.header.frame_id)
        self.statistics.taken += 1
        self.statistics.given += 1
        self.statistics.add_duration(time.monotonic_ns() - begun_ns)


class MarkersNode(Node):
    """Node that converts every message of /skeletons into markers, while they have a subscriber."""

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
        """Do nothing: the node has no threads."""

    def _is_wanted(self) -> bool:
        return bool(self._publisher.get_subscription_count())

    def _take(self, poses: TrackedPoseSet, skeleton: SkeletonModel, frame_id: str) -> None:
        there = set(poses.ids.tolist())
        gone, self._shown = self._shown - there, there
        self._publisher.publish(marker_array(poses, skeleton, frame_id, gone, ros_messages()))


KINDS = {  # outputs made from /skeletons: topic and message type
    "roots": ("skeletons/roots", "geometry_msgs/msg/PoseArray"),
    "tf": ("/tf", "tf2_msgs/msg/TFMessage"),
    "bodies": ("/humans/bodies/tracked", "hri_msgs/msg/IdsList"),
    "boxes": ("skeletons/boxes", "vision_msgs/msg/Detection3DArray"),
}
OF_BODIES = ("joints", "segments", "stream")  # outputs made from /bodies by `BodyOutputs`
# published on demand; "tf" is excluded because it reaches every node that listens to TF
DEFAULT = ("roots", "bodies", "boxes")

Writer = Callable[[TrackedPoseSet, SkeletonModel, str], Any]


class PeopleNode(Node):
    """Node that publishes /skeletons and /bodies as other messages, each while it has a subscriber.

    Parameters: `publish`, a list of `KINDS` and `OF_BODIES`; `segments`, body model as in
    `kinematics.segments`; `tf_prefix`, prefix of frame names, e.g. "hall/". Outputs whose message packages
    are not installed are omitted with one log line.

    Raises:
        ConfigError: if `publish` contains another name.
    """

    fault = None
    healthy = True

    def __init__(self, flow: str = "live", overrides: Mapping[str, Any] = {}):
        super().__init__(
            "people", parameter_overrides=[Parameter(key, value=value) for key, value in overrides.items()]
        )
        wanted: Sequence[str] = self.declare_parameter("publish", list(DEFAULT)).value
        self._prefix = str(self.declare_parameter("tf_prefix", "").value)
        unknown = [name for name in wanted if name not in (*KINDS, *OF_BODIES)]
        if unknown:
            known = ", ".join((*KINDS, *OF_BODIES))
            raise ConfigError(f"people cannot be published as {unknown[0]!r}; known: {known}")
        writers: dict[str, Writer] = {
            "roots": lambda poses, skeleton, frame: roots_message(poses, skeleton, frame, ros_messages()),
            "tf": self._transforms,
            "bodies": lambda poses, skeleton, frame: bodies_message(poses, frame, ros_messages()),
            "boxes": lambda poses, skeleton, frame: boxes_message(poses, frame, ros_messages()),
        }
        self._outputs: list[tuple[Any, Writer]] = []
        for name in (name for name in wanted if name in KINDS):
            topic, kind = KINDS[name]
            try:
                cls = message_class(kind)
            except EnvironmentProblem:
                package = kind.split("/")[0]
                self.get_logger().info(f"no {topic}: the package {package} is not installed here")
                continue
            quality = QoSProfile(depth=100 if name == "tf" else 10)
            self._outputs.append((self.create_publisher(cls, topic, quality), writers[name]))
        self._reader = SkeletonsReader(self, flow, self._is_wanted, self._take)
        segments = str(self.declare_parameter("segments", DEFAULT_MODEL).value)
        words = [name for name in wanted if name in OF_BODIES]
        self._bodies = BodyOutputs(self, flow, words, segments, self._prefix) if words else None

    def close(self) -> None:
        """Stop the JSON stream."""
        if self._bodies is not None:
            self._bodies.close()

    @property
    def published(self) -> tuple[str, ...]:
        """Return the full names of the topics."""
        return tuple(str(publisher.topic_name) for publisher, _ in self._outputs)

    def _is_wanted(self) -> bool:
        return any(publisher.get_subscription_count() for publisher, _ in self._outputs)

    def _take(self, poses: TrackedPoseSet, skeleton: SkeletonModel, frame_id: str) -> None:
        for publisher, write in self._outputs:
            if publisher.get_subscription_count():
                publisher.publish(write(poses, skeleton, frame_id))

    def _transforms(self, poses: TrackedPoseSet, skeleton: SkeletonModel, frame_id: str) -> Any:
        family = ros_messages()
        solved = frozenset[int]() if self._bodies is None else self._bodies.framed
        rows = joint_transforms(poses, skeleton, frame_id, self._prefix, family, solved)
        return family.make("tf2_msgs/msg/TFMessage", transforms=rows)
