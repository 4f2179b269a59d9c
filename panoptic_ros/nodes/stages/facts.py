"""Latched facts that every stage needs: rig and skeleton model.

A new /rig that comes while the graph runs is adopted between two records. If several come, only the newest is
adopted.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from rclpy.node import Node

from panoptic_ros.domain import Rig, SkeletonModel
from panoptic_ros.errors import ConfigError, DataError, PanopticError
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.messages import from_message
from panoptic_ros.nodes.middleware.family import message_class
from panoptic_ros.nodes.middleware.quality import LATCHED


class FactsSubscriber:
    """Subscriber that waits for the rig and the skeleton model.

    A later rig is offered to the node. A later skeleton model is not adopted, and a warning is logged.

    Args:
        on_ready: Called once, with both.
        on_bad: Called with the error of an unusable message, which is ignored.
        on_rig: Called with a new rig that comes later. Raises ConfigError if the node cannot adopt it.
        needs_cameras: Whether a rig without cameras is unusable.
    """

    def __init__(
        self,
        node: Node,
        on_ready: Callable[[Rig, SkeletonModel], None],
        on_bad: Callable[[PanopticError], None],
        on_rig: Callable[[Rig], None],
        needs_cameras: bool = True,
    ):
        self._needs_cameras = needs_cameras
        self._node, self._on_ready, self._on_bad, self._on_rig = node, on_ready, on_bad, on_rig
        self._taken: dict[str, tuple[Any, Any]] = {}  # message and record by key of the topic
        self._unfit: dict[str, str] = {}  # by key: reason why the newest message is not adopted
        self._ready = False
        self._kept = [
            node.create_subscription(
                message_class(TOPICS[key].message), TOPICS[key].name, partial(self._take, key), LATCHED
            )
            for key in ("rig", "skeleton_model")
        ]

    @property
    def rig(self) -> Rig:
        """Return the rig; valid only when both facts have arrived."""
        record: Rig = self._taken["rig"][1]
        return record

    @property
    def skeleton(self) -> SkeletonModel:
        """Return the skeleton model; valid only when both facts have arrived."""
        record: SkeletonModel = self._taken["skeleton_model"][1]
        return record

    @property
    def missing(self) -> list[str]:
        """Return the names of the topics that have not arrived."""
        return [TOPICS[key].name for key in ("rig", "skeleton_model") if key not in self._taken]

    @property
    def unfit(self) -> list[str]:
        """Return the reasons why the newest messages are not adopted."""
        return list(self._unfit.values())

    def take_over(self, rig: Rig) -> None:
        """Use another rig from now on."""
        self._taken["rig"] = self._taken["rig"][0], rig

    def _take(self, key: str, message: Any) -> None:
        try:
            record = from_message(message, TOPICS[key].record)
            if key == "rig" and self._needs_cameras and not record.cameras:
                raise DataError("/rig is a rig without cameras")
        except PanopticError as error:
            self._on_bad(error)
            return
        if not self._ready:
            self._taken[key] = message, record
            if len(self._taken) == len(self._kept):
                self._ready = True
                self._on_ready(self.rig, self.skeleton)
        elif message != self._taken[key][0]:
            self._taken[key] = message, self._taken[key][1]
            self._change(key, record)

    def _change(self, key: str, record: Any) -> None:
        self._unfit.pop(key, None)
        if self._is_in_use(key, record):
            return
        try:
            if key != "rig":
                name = self._node.get_name()
                raise ConfigError(f"another /{key} has been received: restart node {name} to use it")
            self._on_rig(record)
        except ConfigError as error:
            self._unfit[key] = str(error)
            self._node.get_logger().warning(str(error), throttle_duration_sec=5.0)

    def _is_in_use(self, key: str, record: Any) -> bool:
        """Return whether a skeleton model is already in use.

        A rig is always offered again, even if it is equal.
        """
        return key != "rig" and bool(record.hash == self.skeleton.hash)


class RigChanges:
    """Adoption of new rigs by a node, if they fit.

    Args:
        cameras: Names of the cameras in use. Empty: all cameras of the rig.
        note: Schedules a call between two records.
        change: Adopts a rig. Returns the names of the stages that restart with an empty state.
    """

    def __init__(
        self,
        node: Any,
        cameras: Sequence[str],
        note: Callable[[Callable[[], None]], None],
        change: Callable[[Rig], Sequence[str]],
    ):
        self._node, self._cameras, self._note, self._change = node, cameras, note, change
        self._next: Rig | None = None

    def offer(self, rig: Rig, now: Rig) -> None:
        """Adopt a rig as soon as possible.

        Raises:
            ConfigError: if its cameras or image sizes differ from the current rig.
        """
        if self._named(rig) != self._named(now):
            raise ConfigError(
                f"another /rig has other cameras: restart node {self._node.get_name()} to use it"
            )
        waits, self._next = self._next is not None, rig
        if not waits:
            self._note(self._take_over)

    def _take_over(self) -> None:
        rig, self._next = self._next, None
        assert rig is not None
        anew = self._change(rig)
        kept = f"; {', '.join(anew)} start again" if anew else ""
        self._node.get_logger().info(f"another /rig is in use now{kept}", throttle_duration_sec=5.0)

    def _named(self, rig: Rig) -> list[tuple[str, tuple[int, int]]]:
        wanted = self._cameras or list(rig.names)
        return [(camera.name, camera.image_size) for camera in rig.cameras if camera.name in wanted]
