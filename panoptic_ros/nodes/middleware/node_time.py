"""The time of a node, for those who ask thousands of times a second."""

from __future__ import annotations

import time

from rclpy.clock import ROSClock
from rclpy.node import Node


def now_of(node: Node) -> int:
    """The node's time, ns: the system's, unless it is simulated."""
    clock = node.get_clock()
    if isinstance(clock, ROSClock) and not clock.ros_time_is_active:
        return time.time_ns()
    return int(clock.now().nanoseconds)
