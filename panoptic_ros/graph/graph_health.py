"""How the whole graph is, from what its nodes say of themselves, and from who has gone silent."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from panoptic_ros.graph.arrivals import SECOND
from panoptic_ros.graph.health import Status

NAME = "graph"
SILENT_NS = 5 * SECOND // 2  # nodes tell of themselves once a second
NAMED = 4  # troubles in the message


@dataclass
class _Heard:
    newest_ns: int
    finished: bool = False
    troubles: dict[str, str] = field(default_factory=dict)  # by status


class GraphHealth:
    """One status for all nodes of a graph. Times are of one monotonic clock, ns."""

    def __init__(self) -> None:
        self._nodes: dict[str, _Heard] = {}

    def heard(self, name: str, values: Mapping[str, str], trouble: str, now_ns: int) -> None:
        """A status of a node has come.

        Args:
            name: of the status, without prefix and namespace. trouble: its message, "" if all is well.
        """
        node = values.get("node")
        if node is None:
            return
        known = self._nodes.setdefault(node, _Heard(now_ns))
        known.newest_ns = now_ns
        if "finished" in values:
            known.finished = values["finished"] == "true"
        if trouble:
            known.troubles[name] = trouble
        else:
            known.troubles.pop(name, None)

    def statuses(self, now_ns: int) -> list[Status]:
        """The one status."""
        silent = {
            node: (now_ns - heard.newest_ns) / SECOND
            for node, heard in self._nodes.items()
            if now_ns - heard.newest_ns > SILENT_NS and not heard.finished
        }
        gone = [f"node {node} has not been heard for {age:.1f} s" for node, age in silent.items()]
        others = [
            f"{name}: {trouble}"
            for node, heard in self._nodes.items()
            if node not in silent
            for name, trouble in heard.troubles.items()
        ]
        told = gone + others
        more = [f"and {len(told) - NAMED} more"] if len(told) > NAMED else []
        values = {
            "nodes": str(len(self._nodes)),
            "silent": ", ".join(silent),
            "warnings": str(len(told)),
        }
        return [Status(NAME, "; ".join(told[:NAMED] + more), "", values)]
