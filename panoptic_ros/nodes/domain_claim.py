"""One run at a time in a ROS domain: the topics of two graphs would mix unnoticed."""
from __future__ import annotations

import os
import socket
import time

from rclpy.node import Node

from panoptic_ros.errors import EnvironmentProblem
from panoptic_ros.graph.topics import TOPICS

DISCOVERY_S = 1.0  # within this, graphs that run already have been heard of


def claim_domain() -> socket.socket:
    """Claim this machine's ROS domain for this process, until the result is closed or the process ends.

    An abstract socket's name is taken in one step, and free again whatever ends its owner; ROS's
    discovery takes a second, in which two runs that start together would not see each other.

    Raises:
        EnvironmentProblem: if another run has it.
    """
    claim = socket.socket(socket.AF_UNIX)
    try:
        claim.bind(f"\0panoptic_ros/run/{_domain()}")
    except OSError:
        claim.close()
        raise EnvironmentProblem(
            f"another `panoptic run` is going on in ROS domain {_domain()}; wait for it, or set "
            "ROS_DOMAIN_ID to another number"
        ) from None
    return claim


def require_no_other_graph(node: Node) -> None:
    """Look for graphs that were started in other ways, e.g. by `ros2 launch`.

    Raises:
        EnvironmentProblem: if somebody publishes /skeletons already.
    """
    deadline = time.monotonic() + DISCOVERY_S
    while time.monotonic() < deadline:
        if node.count_publishers(TOPICS["skeletons"].name):
            raise EnvironmentProblem(
                f"another graph publishes /skeletons in ROS domain {_domain()}; stop it, or set "
                "ROS_DOMAIN_ID to another number"
            )
        time.sleep(0.1)


def _domain() -> str:
    return os.environ.get("ROS_DOMAIN_ID") or "0"
