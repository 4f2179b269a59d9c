"""Poses of camera frames from TF; /tf and /tf_static are read directly, without the library tf2."""

from __future__ import annotations

import difflib
import time
from collections.abc import Sequence
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions

from panoptic_ros.errors import CalibrationError, DataError, EnvironmentProblem
from panoptic_ros.geometry import Rigid
from panoptic_ros.geometry.frames import FrameTree
from panoptic_ros.io.messages.transforms import read_transform
from panoptic_ros.nodes.middleware.family import message_class

KIND = "tf2_msgs/msg/TFMessage"
PATIENCE_S = 5.0
SETTLE_S = 0.5  # extra wait after all frames have arrived, for transforms above the current root
NAMED = 12  # most frames that an error message lists


def find_transforms(
    frames: Sequence[str], fixed: str = "", patience_s: float = PATIENCE_S
) -> tuple[str, dict[str, Rigid]]:
    """Return the fixed frame and the current transform fixed_from_frame of every frame.

    Args:
        fixed: Name of the world frame. "": the root of the tree that contains all frames.
        patience_s: Longest wait for the transforms.

    Raises:
        EnvironmentProblem: if the messages of TF are not installed, or no node publishes any.
        CalibrationError: names a frame that is missing or not connected.
    """
    try:
        kind = message_class(KIND)
    except EnvironmentProblem:
        raise EnvironmentProblem(
            "poses of cameras from TF need the package tf2_msgs: `./run messages tf2_msgs` builds it (native "
            "ROS has it); or give the calibration with --rig"
        ) from None
    context = Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    node = Node("panoptic_tf", context=context, enable_rosout=False, start_parameter_services=False)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    try:
        transforms = _TransformListener(node, kind)
        return transforms.wait(executor, frames, fixed, patience_s)
    finally:
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()


class _TransformListener:
    def __init__(self, node: Node, kind: Any):
        self._found: dict[str, tuple[str, Rigid]] = {}
        self._bad: list[str] = []
        latched = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._kept = [
            node.create_subscription(kind, "/tf_static", self._take, latched),
            node.create_subscription(kind, "/tf", self._take, QoSProfile(depth=100)),
        ]

    def wait(
        self, executor: SingleThreadedExecutor, frames: Sequence[str], fixed: str, patience_s: float
    ) -> tuple[str, dict[str, Rigid]]:
        """Wait until all frames are connected and return the transforms as `find_transforms` does.

        After that, wait `SETTLE_S` more for transforms that may still come. The wait is at most `patience_s`.
        """
        begin = time.monotonic()
        complete_since: float | None = None
        while time.monotonic() < begin + patience_s:
            executor.spin_once(timeout_sec=0.05)
            complete = self._is_complete(frames, fixed)
            complete_since = (complete_since or time.monotonic()) if complete else None
            if complete_since is not None and time.monotonic() > complete_since + SETTLE_S:
                break
        return self._resolved(frames, fixed, patience_s)

    def _is_complete(self, frames: Sequence[str], fixed: str) -> bool:
        tree = FrameTree(self._found)
        if not tree.names.issuperset(frames):
            return False
        tops = {tree.root(frame) for frame in frames}
        return len(tops) == 1 and (not fixed or (fixed in tree.names and tree.root(fixed) in tops))

    def _resolved(self, frames: Sequence[str], fixed: str, patience_s: float) -> tuple[str, dict[str, Rigid]]:
        tree = FrameTree(self._found)
        if not self._found:
            told = f" ({self._bad[0]})" if self._bad else ""
            raise EnvironmentProblem(
                f"no message on /tf or /tf_static within {patience_s:g} s{told}: is a "
                "robot_state_publisher or static_transform_publisher running? Or give --rig"
            )
        for frame in (*frames, *((fixed,) if fixed else ())):
            if frame not in tree.names:
                like = difflib.get_close_matches(frame, tree.names, NAMED, 0.0)
                raise CalibrationError(
                    f"TF has no frame {frame!r}; it has {', '.join(like)}. Publish its transform (e.g. "
                    f"static_transform_publisher --frame-id {fixed or 'map'} --child-frame-id {frame}), or "
                    "give --rig"
                )
        world = fixed or tree.root(frames[0])
        try:
            return world, {frame: tree.fixed_from(world, frame) for frame in frames}
        except CalibrationError as error:
            raise CalibrationError(
                f"{error}; publish a transform that connects them, or give --rig"
            ) from None

    def _take(self, message: Any) -> None:
        for transform in message.transforms:
            try:
                parent, child, parent_from_child = read_transform(transform)
            except DataError as error:
                self._bad.append(str(error))
                continue
            self._found[child] = parent, parent_from_child
