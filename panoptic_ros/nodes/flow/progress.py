"""How far topics have come, from node to node (replay, see `graph.lanes`)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from rclpy.node import Node

from panoptic_ros.graph.schedule import Place
from panoptic_ros.nodes.middleware.family import message_class, ros_messages
from panoptic_ros.nodes.middleware.quality import PROGRESS

TOPIC = "progress"
KIND = "panoptic_msgs/msg/Progress"


class ProgressTold:
    """Tells it of the node's own topics, and hears it of others.

    Args:
        on_progress: called with (full name of a topic, place, number of messages before it).
    """

    def __init__(self, node: Node, on_progress: Callable[[str, Place, int], None]):
        self._on_progress = on_progress
        self._publisher = node.create_publisher(message_class(KIND), TOPIC, PROGRESS)
        self._subscription = node.create_subscription(message_class(KIND), TOPIC, self._heard, PROGRESS)

    def tell(self, topic: str, count: int, place: Place) -> None:
        """Tell it of a topic (its full name)."""
        family = ros_messages()
        numbers = family.sequence(np.array(place, np.int64))
        self._publisher.publish(family.make(KIND, topic=topic, count=count, place=numbers))

    def _heard(self, message: Any) -> None:
        self._on_progress(message.topic, tuple(int(n) for n in message.place), int(message.count))
