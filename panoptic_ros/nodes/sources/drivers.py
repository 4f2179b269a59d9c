"""Discovery of running camera drivers: types of their topics, and their CameraInfo messages."""

from __future__ import annotations

import difflib
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from panoptic_ros.errors import EnvironmentProblem
from panoptic_ros.nodes.middleware.family import message_class

PATIENCE_S = 10.0  # for drivers that start at the same time as this program
OTHERS = 12  # most topics that an error message lists
ANY_OFFER = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"


@dataclass
class DriverSearchResult:
    """Result of the search.

    Args:
        types: "package/msg/Name" by topic.
        infos: CameraInfo message by topic.
    """

    types: dict[str, str] = field(default_factory=dict)
    infos: dict[str, Any] = field(default_factory=dict)


def find_drivers(topics: Mapping[str, str], patience_s: float = PATIENCE_S) -> DriverSearchResult:
    """Look up topics that have a publisher, and take one message of each CameraInfo topic.

    Args:
        topics: purpose of each topic, by its name.
        patience_s: longest wait for all topics.

    Raises:
        EnvironmentProblem: names a topic without publisher and similar existing topics, or a missing
            CameraInfo.
    """
    context = Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    node = Node("panoptic_drivers", context=context, enable_rosout=False, start_parameter_services=False)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    try:
        return _DriverSearch(node, executor, topics).run(patience_s)
    finally:
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()


class _DriverSearch:
    def __init__(self, node: Node, executor: SingleThreadedExecutor, topics: Mapping[str, str]):
        self._node, self._executor, self._topics = node, executor, topics
        self._found = DriverSearchResult()
        self._kept: list[Any] = []

    def run(self, patience_s: float) -> DriverSearchResult:
        """Wait until all topics and CameraInfo messages have been found."""
        deadline = time.monotonic() + patience_s
        while not self._is_complete():
            if time.monotonic() > deadline:
                raise EnvironmentProblem(self._missing(patience_s))
            self._look()
            self._executor.spin_once(timeout_sec=0.1)
        return self._found

    def _is_complete(self) -> bool:
        found = self._found
        return found.types.keys() >= self._topics.keys() and len(found.infos) == len(self._kept)

    def _look(self) -> None:
        for topic in self._topics.keys() - self._found.types.keys():
            publishers = self._node.get_publishers_info_by_topic(topic)
            if not publishers:
                continue
            self._found.types[topic] = kind = publishers[0].topic_type
            if kind == CAMERA_INFO:
                take = partial(self._found.infos.setdefault, topic)
                self._kept.append(self._node.create_subscription(message_class(kind), topic, take, ANY_OFFER))

    def _missing(self, patience_s: float) -> str:
        """Return the reason of the failed search, in one line."""
        silent = [topic for topic, kind in self._found.types.items() if kind == CAMERA_INFO]
        for topic, what in self._topics.items():
            if topic not in self._found.types:
                return f"no node publishes {topic} ({what}) within {patience_s:g} s; {self._others(topic)}"
        topic = next(topic for topic in silent if topic not in self._found.infos)
        what = self._topics[topic]
        return f"no message came on {topic} ({what}) within {patience_s:g} s: is its driver running?"

    def _others(self, topic: str) -> str:
        kinds = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage", CAMERA_INFO)
        names = [name for name, types in self._node.get_topic_names_and_types() if set(types) & set(kinds)]
        like = difflib.get_close_matches(topic, names, OTHERS, 0.0)
        return (
            f"there are {', '.join(like)}"
            if like
            else (
                "no camera publishes images here: is the driver running, in this ROS_DOMAIN_ID "
                "(ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET reaches other machines)?"
            )
        )
