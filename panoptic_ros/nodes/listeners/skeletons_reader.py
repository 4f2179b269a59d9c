"""Nodes that say /skeletons in other words."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from rclpy.node import Node

from panoptic_ros.domain import SkeletonModel, TrackedPoseSet
from panoptic_ros.errors import DataError, PanopticError
from panoptic_ros.graph.counters import StageStatistics
from panoptic_ros.graph.flow import make_flow
from panoptic_ros.graph.health import Health
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.messages import from_message
from panoptic_ros.nodes.health.diagnostics import Diagnostics
from panoptic_ros.nodes.middleware.family import message_class
from panoptic_ros.nodes.middleware.packets import unpacked
from panoptic_ros.nodes.middleware.quality import LATCHED, collecting_quality

Take = Callable[[TrackedPoseSet, SkeletonModel, str], None]  # (people, their skeleton, the world's frame)


class SkeletonsReader:
    """Reads /skeletons for a node, as long as somebody wants what it makes of them, and tells how it goes on
    /diagnostics.

    Args:
        wanted: asked before a message is read. take: called with what it says.
    """

    def __init__(self, node: Node, flow: str, wanted: Callable[[], bool], take: Take):
        self._node, self._wanted, self._take = node, wanted, take
        self._skeleton: SkeletonModel | None = None
        self.statistics = StageStatistics()
        name = node.get_name()
        self._health = Health(name, {name: self.statistics}, live=flow == "live")
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
