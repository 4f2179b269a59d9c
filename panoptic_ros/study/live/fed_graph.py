"""The live graph after detection in processes of its own, fed from this one, and what is seen of it.

Floods of bad messages on topics of the live graph, from a process of their own.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Sequence
from typing import Any, NamedTuple

from panoptic_ros.errors import EnvironmentProblem
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.running.processes.children import Processes, child_environment
from panoptic_ros.running.processes.usage import Usage, usage_of
from panoptic_ros.study.live.graph_feed import Feed
from panoptic_ros.study.live.graph_figures import Flooded, Observation, Restart, figures_of
from panoptic_ros.study.live.player import LAST_WORDS_S, SETTLE_NS, Player, played

RESTART_PATIENCE_S = 60.0  # for skeletons after a process was killed
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


def run_fed_graph(
    feed: Feed, seconds: float, node_per_stage: bool, kill: bool = False, flood_s: float = 0.0
) -> dict[str, Any]:
    """Feed the graph until skeletons have come for so long; see `graph_figures.figures_of`.

    Args:
        kill: afterwards kill each process in turn, to see how long it is silent and whom it still knows.
        flood_s: afterwards send floods of bad messages, each for so long; 0: none.

    Raises:
        UserError: as a node printed it, if one ended.
        EnvironmentProblem: if another graph runs in this ROS domain, or no skeletons come.
    """
    floods = floods_of(feed.rig.names[0], node_per_stage) if flood_s else []
    observation: Observation = played(
        feed, node_per_stage, lambda: _Run(feed, seconds, kill, floods, flood_s)
    )
    return figures_of(observation)


class _Run(Player):
    """Plays, then kills and floods if that is asked for."""

    def __init__(self, feed: Feed, seconds: float, kill: bool, floods: Sequence[Flood], flood_s: float):
        super().__init__(feed, kill)
        self._seconds, self._kill = seconds, kill
        self._floods, self._flood_s = floods, flood_s

    def do(self, processes: Processes) -> Observation:
        """See `Player`."""
        ids = processes.ids
        before: Usage | None = None
        while before is None or time.monotonic_ns() < before.at_ns + 1e9 * self._seconds:
            self.play()
            if self.number % 15 == 0:
                processes.check()
            if before is None and self.is_settled():
                before = usage_of(ids)
        after = usage_of(ids)
        sent = list(self.sent)
        restarts = [self._restart(processes, name) for name in processes.names] if self._kill else []
        floods = [self._flood(processes, flood) for flood in self._floods]
        if floods:
            sent = list(self.sent)
        self.spin_until(time.monotonic_ns() + round(1e9 * LAST_WORDS_S))
        return Observation(
            sent,
            self.received,
            self.feed.period_ns,
            self.started,
            before.at_ns,
            before,
            after,
            self.node.diagnostics,
            restarts,
            floods,
        )

    def _restart(self, processes: Processes, name: str) -> Restart:
        """Kill a process, and play on until its successor has settled."""
        self.play_until(time.monotonic_ns() + SETTLE_NS)
        _, before = self.newest
        killed = time.monotonic_ns()
        since, back = self.stamps_from + killed, None
        processes.kill(name)
        while back is None and time.monotonic_ns() < killed + 1e9 * RESTART_PATIENCE_S:
            self.play()
            processes.revive()
            back = next((when for stamp, when in reversed(self.received) if stamp > since), None)
        self.play_until(time.monotonic_ns() + SETTLE_NS)
        came = [when for stamp, when in self.received if stamp > since]
        silence_s = 1e-9 * (min(came) - killed) if came else None
        return Restart(name, silence_s, before, self.newest[1])

    def _flood(self, processes: Processes, flood: Flood) -> Flooded:
        """Play on while bad messages come."""
        self.play_until(time.monotonic_ns() + SETTLE_NS)
        begun = time.monotonic_ns()
        with Flooder(flood, self._flood_s) as flooder:
            while not flooder.over:
                self.play()
                if self.number % 15 == 0:
                    processes.check()
            messages = flooder.sent()
        ended = self.sent[-1][1]
        self.play_until(time.monotonic_ns() + SETTLE_NS)
        return Flooded(flood.title, messages, begun, ended)
