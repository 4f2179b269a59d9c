"""Looking for other graphs in the domain of a run, while it is planned and its processes load."""

from __future__ import annotations

from panoptic_ros.nodes.listeners.domain_claim import Listener
from panoptic_ros.running.processes.children import Ahead


def begin_to_listen(ahead: Ahead, namespace: str) -> None:
    """Listen from now on.

    Raises:
        UsageError, EnvironmentProblem: as `Listener`.
    """
    ahead.listener = Listener(namespace)


def require_no_other_graph(ahead: Ahead, namespace: str) -> None:
    """Look for other graphs when there was time enough to hear of them, then listen no more.

    Raises:
        EnvironmentProblem: if there is one.
    """
    listener, ahead.listener = ahead.listener or Listener(namespace), None
    try:
        listener.require_no_other_graph()
    finally:
        listener.close()
