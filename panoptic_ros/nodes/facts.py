"""The latched facts that every stage works with: rig and skeleton model."""
from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.node import Node

from panoptic_ros.domain import Rig, SkeletonModel
from panoptic_ros.errors import PanopticError
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.messages import from_message
from panoptic_ros.nodes.family import message_class
from panoptic_ros.nodes.quality import LATCHED


class Facts:
    """Waits for both; a node keeps those that it began with, and says so when others come.

    Args:
        on_ready: called once, with both.
        on_bad: told about messages that cannot be used, which are left out.
    """

    def __init__(
        self,
        node: Node,
        on_ready: Callable[[Rig, SkeletonModel], None],
        on_bad: Callable[[PanopticError], None],
    ):
        self._node, self._on_ready, self._on_bad = node, on_ready, on_bad
        self._taken: dict[str, tuple[Any, Any]] = {}  # message and record
        self._ready = False
        self._kept = [
            node.create_subscription(
                message_class(TOPICS[key].message), TOPICS[key].name, partial(self._take, key), LATCHED
            )
            for key in ("rig", "skeleton_model")
        ]

    @property
    def rig(self) -> Rig:
        """Only once both are there."""
        record: Rig = self._taken["rig"][1]
        return record

    @property
    def skeleton(self) -> SkeletonModel:
        """Only once both are there."""
        record: SkeletonModel = self._taken["skeleton_model"][1]
        return record

    def _take(self, key: str, message: Any) -> None:
        try:
            record = from_message(message, TOPICS[key].record)
        except PanopticError as error:
            self._on_bad(error)
            return
        if not self._ready:
            self._taken[key] = message, record
            if len(self._taken) == len(self._kept):
                self._ready = True
                self._on_ready(self.rig, self.skeleton)
        elif message != self._taken[key][0]:
            name = self._node.get_name()
            self._node.get_logger().warning(f"another /{key} has come: restart node {name} to work with it")
