"""/skeletons and /bodies in the words of other packages: roots, TF, REP-155 bodies, boxes, joint angles."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile

from panoptic_ros.domain import SkeletonModel, TrackedPoseSet
from panoptic_ros.errors import ConfigError, EnvironmentProblem
from panoptic_ros.io.body_models import DEFAULT_MODEL
from panoptic_ros.io.messages.people import bodies_message, boxes_message, joint_transforms, roots_message
from panoptic_ros.nodes.listeners.body_outputs import BodyOutputs
from panoptic_ros.nodes.listeners.skeletons_reader import SkeletonsReader
from panoptic_ros.nodes.middleware.family import message_class, ros_messages

KINDS = {  # what can be published: topic and message
    "roots": ("skeletons/roots", "geometry_msgs/msg/PoseArray"),
    "tf": ("/tf", "tf2_msgs/msg/TFMessage"),
    "bodies": ("/humans/bodies/tracked", "hri_msgs/msg/IdsList"),
    "boxes": ("skeletons/boxes", "vision_msgs/msg/Detection3DArray"),
}
OF_BODIES = ("joints", "segments", "stream")  # what `body_outputs` makes of /bodies
DEFAULT = ("roots", "bodies", "boxes")  # on demand; TF reaches everybody, so it is asked for

Writer = Callable[[TrackedPoseSet, SkeletonModel, str], Any]


class PeopleNode(Node):
    """Publishes /skeletons, and /bodies, as other messages, each while somebody subscribes to it.

    Parameters: `publish`: which of `KINDS` and `OF_BODIES`; `segments`: skeleton of the bodies, as
    `kinematics.segments`; `tf_prefix`: before the names of frames, e.g. "hall/". What
    needs messages that are not installed is left out with one line in the log.

    Raises:
        ConfigError: if `publish` names something else.
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
        """Stop the stream."""
        if self._bodies is not None:
            self._bodies.close()

    @property
    def published(self) -> tuple[str, ...]:
        """Full names of the topics."""
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
