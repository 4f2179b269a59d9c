"""Looks for other graphs in the ROS domain of a run, while the run is planned and its processes load."""

from __future__ import annotations

from panoptic_ros.nodes.listeners.domain_claim import GraphListener
from panoptic_ros.running.processes.children import LaunchPreparation


def begin_to_listen(ahead: LaunchPreparation, namespace: str) -> None:
    """Start listening for other graphs.

    Raises:
        UsageError, EnvironmentProblem: as `GraphListener`.
    """
    ahead.listener = GraphListener(namespace)


def require_no_other_graph(ahead: LaunchPreparation, namespace: str) -> None:
    """Check that no other graph runs, after the time that discovery needs; then stop listening.

    Raises:
        EnvironmentProblem: if there is another graph.
    """
    listener, ahead.listener = ahead.listener or GraphListener(namespace), None
    try:
        listener.require_no_other_graph()
    finally:
        listener.close()
