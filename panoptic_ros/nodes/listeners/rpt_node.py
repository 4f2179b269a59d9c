"""Node that converts the 2D poses of RapidPoseTriangulation into detections of this graph."""

from __future__ import annotations

from functools import partial
from typing import Any

from rclpy.node import Node
from rclpy.parameter import Parameter

from panoptic_ros.domain import Rig
from panoptic_ros.errors import ConfigError, DataError, PanopticError
from panoptic_ros.graph.flow import make_flow
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.messages import from_message, to_message
from panoptic_ros.io.messages.rpt import KIND, view_of_poses
from panoptic_ros.io.skeletons import DEFAULT_SKELETON
from panoptic_ros.nodes.middleware.family import message_class, ros_messages
from panoptic_ros.nodes.middleware.negotiation import NegotiatedSubscription
from panoptic_ros.nodes.middleware.packets import unpacked
from panoptic_ros.nodes.middleware.quality import LATCHED, data_quality
from panoptic_ros.params import named_words
from panoptic_ros.stage import Notice


class RptNode(Node):
    """Node that converts rpt_msgs/Poses into `/<camera>/detections`.

    It waits for /rig. Parameters: `topics`, a list of "<camera>=<topic>"; `skeleton`, the name of the working
    skeleton.

    Raises:
        ConfigError: if there are no topics.
        EnvironmentProblem: if rpt_msgs is not installed.
    """

    fault: PanopticError | None = None

    def __init__(self, overrides: dict[str, Any] | None = None):
        given = [Parameter(key, value=value) for key, value in (overrides or {}).items()]
        super().__init__("rpt", parameter_overrides=given)
        words = self.declare_parameter("topics", Parameter.Type.STRING_ARRAY).value or []
        self._topics = named_words("topics", list(words))
        self._skeleton = str(self.declare_parameter("skeleton", DEFAULT_SKELETON).value)
        if not self._topics:
            raise ConfigError("node rpt needs the parameter `topics`, e.g. ['cam1=/poses/cam1']")
        self._kind = message_class(KIND)
        self._counts: dict[str, int] = {}
        self._kept: list[Any] = []
        rig = TOPICS["rig"]
        self._rig = self.create_subscription(message_class(rig.message), rig.name, self._take_rig, LATCHED)

    @property
    def healthy(self) -> bool:
        """Return False after a fault."""
        return self.fault is None

    def close(self) -> None:
        """Do nothing: the node has no threads."""

    def _take_rig(self, message: Any) -> None:
        if self._kept:
            return
        try:
            rig: Rig = from_message(message, "Rig")
            for name, topic in self._topics.items():
                self._begin(rig, name, topic)
        except PanopticError as error:
            self.fault = error

    def _begin(self, rig: Rig, name: str, topic: str) -> None:
        camera, row, flow = rig.camera(name), TOPICS["detections"], make_flow("live")
        publisher = self.create_publisher(message_class(row.message), row.of(name), data_quality(flow))
        take = partial(self._take, camera, publisher)
        quality = data_quality(flow)
        self._kept += [
            publisher,
            NegotiatedSubscription(self, self._kind, topic, take, quality, True, self._tell),
        ]

    def _take(self, camera: Any, publisher: Any, data: bytes, sequence: int) -> None:
        number = self._counts.get(camera.name, 0)
        self._counts[camera.name] = number + 1
        try:
            view = view_of_poses(
                unpacked(data, self._kind), camera.name, camera.image_size, number, self._skeleton
            )
        except DataError as error:
            self.get_logger().warning(f"dropped: {error}", throttle_duration_sec=5.0)
            return
        publisher.publish(to_message(view, ros_messages()))

    def _tell(self, notice: Notice) -> None:
        self.get_logger().warning(notice.text)
