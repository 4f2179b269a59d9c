"""Reads the status of live graphs from another shell."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator

from rclpy.executors import SingleThreadedExecutor
from rclpy.utilities import try_shutdown

from panoptic_ros.errors import EnvironmentProblem
from panoptic_ros.graph.health import ReceivedStatus
from panoptic_ros.nodes.listeners.watch_node import WatchNode
from panoptic_ros.nodes.middleware.runtime import start_ros
from panoptic_ros.running.processes.children import prepare_environment

PATIENCE_S = 6.0  # s, timeout for the first status: covers discovery and the 1 s between two statuses
GATHERING_S = 1.5  # s from the first status until all nodes have published a status


def watched(
    namespace: str | None, period_s: float, stop: Callable[[], bool]
) -> Iterator[list[ReceivedStatus]]:
    """Yield the newest statuses of all nodes of live graphs, once per period.

    Args:
        namespace: namespace of one graph; None = all graphs.
        period_s: s between two results.
        stop: stop condition, polled several times a second.

    Raises:
        EnvironmentProblem: if no such graph publishes a status. The message names the graphs that do.
    """
    prepare_environment()
    start_ros([])
    node, executor = WatchNode(), SingleThreadedExecutor()
    executor.add_node(node)
    wanted = None if namespace is None else namespace.strip("/")

    def own() -> list[ReceivedStatus]:
        return [item for item in node.told.values() if wanted in (None, item.namespace)]

    def spin_until(until: float, ready: Callable[[], bool]) -> None:
        while not stop() and not ready() and time.monotonic() < until:
            executor.spin_once(timeout_sec=0.1)

    try:
        spin_until(time.monotonic() + PATIENCE_S, lambda: bool(own()))
        if not own() and not stop():
            raise EnvironmentProblem(_nobody(wanted, node))
        spin_until(time.monotonic() + GATHERING_S, lambda: False)
        while not stop():
            yield own()
            spin_until(time.monotonic() + period_s, lambda: False)
    finally:
        executor.shutdown()
        node.destroy_node()
        try_shutdown()


def _nobody(wanted: str | None, node: WatchNode) -> str:
    others = sorted({f"/{item.namespace}" for item in node.told.values()})
    domain = os.environ.get("ROS_DOMAIN_ID") or "0"
    where = f"in ROS domain {domain}" if wanted is None else f"in namespace /{wanted} of ROS domain {domain}"
    there = (
        f"graphs run in {', '.join(others)}"
        if others
        else "is one running, in this domain? ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET reaches other machines"
    )
    return f"no graph reported its state within {PATIENCE_S:g} s {where}; {there}"
