"""Floods of bad messages on topics of the live graph, from a process of their own."""

from __future__ import annotations

import subprocess
import sys
from typing import NamedTuple

from panoptic_ros.errors import EnvironmentProblem
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.running.processes.children import child_environment

MODULE = "panoptic_ros.nodes.sources.flooding_node"


class Flood(NamedTuple):
    """Damaged messages on one topic.

    Args:
        topic: key of `TOPICS`. owner: camera; "" for topics of the graph.
        rate: messages a second. size: bytes of each, at least.
        aside: on a topic that nobody takes in place of it: what the flood's own processor time costs.
    """

    topic: str
    owner: str
    rate: float
    size: int
    aside: bool = False

    @property
    def title(self) -> str:
        """In words."""
        size = f"{self.size / 1e6:g} MB " if self.size else ""
        where = "a topic nobody takes" if self.aside else f"{self.owner} {self.topic}".strip()
        return f"{where}: {self.rate:g} bad {size}messages a second"


def floods_of(camera: str, between_nodes: bool) -> list[Flood]:
    """Large and many on a camera's topic, and many on each topic that crosses between nodes."""
    graph = ("detection_sets", "associations", "proposals", "poses", "skeletons_raw", "tracks")
    kinds = ((100.0, 1_000_000), (2400.0, 0))
    found = [Flood("detections", camera, *kind, aside) for kind in kinds for aside in (True, False)]
    return found + [Flood(topic, "", 2400.0, 0) for topic in graph if between_nodes]


class Flooder:
    """One flood while it lasts; a context manager that leaves no process behind."""

    def __init__(self, flood: Flood, seconds: float):
        row = TOPICS[flood.topic]
        topic = row.of(flood.owner)
        target = f"{topic}_aside" if flood.aside else topic
        words = [topic, target, row.message, f"{flood.rate}", f"{seconds}", f"{flood.size}"]
        self._process = subprocess.Popen(
            [sys.executable, "-m", MODULE, *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            env=child_environment(),
        )

    @property
    def over(self) -> bool:
        """Whether it has ended."""
        return self._process.poll() is not None

    def sent(self) -> int:
        """How many messages there were; only once it is over.

        Raises:
            EnvironmentProblem: if it broke down.
        """
        told, _ = self._process.communicate()
        if self._process.returncode or not told.strip():
            raise EnvironmentProblem(
                f"the flood ended with exit code {self._process.returncode}; is another process killing ours?"
            )
        return int(told.split()[-1])

    def __enter__(self) -> Flooder:
        return self

    def __exit__(self, *exception: object) -> None:
        if self._process.poll() is None:
            self._process.kill()
            self._process.communicate()
