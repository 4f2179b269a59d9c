"""Exclusive use of a ROS domain by one run: the topics of two graphs would mix without an error."""

from __future__ import annotations

import os
import socket
import time
from typing import Any

from rclpy.context import Context
from rclpy.node import Node

from panoptic_ros.errors import EnvironmentProblem
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.nodes.middleware.runtime import in_namespace, start_ros

DISCOVERY_S = 1.0  # time in which discovery finds graphs that are already running


def claim_domain(namespace: str = "") -> socket.socket:
    """Claim a namespace of the ROS domain for this process, until the socket is closed or the process ends.

    An abstract socket's name is claimed atomically, and the kernel frees it however the process ends. ROS
    discovery takes a second, so two runs that start together would not find each other.

    Raises:
        EnvironmentProblem: if another run has claimed it.
    """
    claim = socket.socket(socket.AF_UNIX)
    try:
        claim.bind(f"\0panoptic_ros/run/{_domain()}/{namespace}".rstrip("/"))
    except OSError:
        claim.close()
        raise EnvironmentProblem(
            f"another `panoptic run` is running in {_where(namespace)}; wait for it, give this one a "
            "--namespace of its own, or set ROS_DOMAIN_ID to another number"
        ) from None
    return claim


class GraphListener:
    """Silent node that discovers graphs in a namespace from its construction on.

    Raises:
        UsageError, EnvironmentProblem: as `in_namespace` and `start_ros`.
    """

    def __init__(self, namespace: str = ""):
        self._context = Context()
        start_ros(in_namespace(namespace), self._context)
        self._node = Node(
            "newcomer", context=self._context, enable_rosout=False, start_parameter_services=False
        )
        self._since_s = time.monotonic()

    def require_no_other_graph(self) -> None:
        """Raise EnvironmentProblem if another graph runs, see `require_no_other_graph`."""
        require_no_other_graph(self._node, self._since_s)

    def close(self) -> None:
        """Destroy the node and its context."""
        self._node.destroy_node()
        self._context.try_shutdown()


def require_no_other_graph(node: Node, since_s: float | None = None) -> None:
    """Check that no other graph runs, e.g. one started by `ros2 launch`.

    Args:
        since_s: monotonic time at which the node was made, s; None: now.

    Raises:
        EnvironmentProblem: if a node already publishes /skeletons.
    """
    deadline = (time.monotonic() if since_s is None else since_s) + DISCOVERY_S
    waiting = True
    while waiting:
        waiting = time.monotonic() < deadline
        topic = node.resolve_topic_name(TOPICS["skeletons"].name)
        others = node.get_publishers_info_by_topic(topic)
        if others:
            raise EnvironmentProblem(
                f"node {_full_name(others[0])} publishes {topic} in {_where(node.get_namespace())} already; "
                "stop it, give this graph a --namespace of its own, or set ROS_DOMAIN_ID to another number"
            )
        if waiting:
            time.sleep(0.05)


def _full_name(publisher: Any) -> str:
    return f"{publisher.node_namespace.rstrip('/')}/{publisher.node_name}"


def _where(namespace: str) -> str:
    name = namespace.strip("/")
    return f"namespace /{name} of ROS domain {_domain()}" if name else f"ROS domain {_domain()}"


def _domain() -> str:
    return os.environ.get("ROS_DOMAIN_ID") or "0"
