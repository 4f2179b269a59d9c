"""Run the live graph after detection in child processes, feed it from this process, and observe it.

It can also flood topics of the graph with bad messages from another process.
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
from panoptic_ros.study.live.graph_figures import FloodRecord, Observation, Restart, figures_of
from panoptic_ros.study.live.player import LAST_WORDS_S, SETTLE_NS, Player, played

RESTART_PATIENCE_S = 60.0  # timeout for skeletons after a process was killed
MODULE = "panoptic_ros.nodes.sources.flooding_node"


class Flood(NamedTuple):
    """Damaged messages on one topic.

    Args:
        topic: key of `TOPICS`.
        owner: camera; "" for topics of the graph.
        rate: (1/s) number of messages.
        size: (bytes) lower limit of the message size.
        aside: publish on a topic without subscribers instead; it measures the processor time of the flood
            itself.
    """

    topic: str
    owner: str
    rate: float
    size: int
    aside: bool = False

    @property
    def title(self) -> str:
        """Return a description."""
        size = f"{self.size / 1e6:g} MB " if self.size else ""
        where = "a topic nobody takes" if self.aside else f"{self.owner} {self.topic}".strip()
        return f"{where}: {self.rate:g} bad {size}messages a second"


def floods_of(camera: str, between_nodes: bool) -> list[Flood]:
    """Return the floods of a run.

    A camera's topic gets large messages and many messages. Each topic between nodes gets many messages.
    """
    graph = ("detection_sets", "associations", "proposals", "poses", "skeletons_raw", "tracks")
    kinds = ((100.0, 1_000_000), (2400.0, 0))
    found = [Flood("detections", camera, *kind, aside) for kind in kinds for aside in (True, False)]
    return found + [Flood(topic, "", 2400.0, 0) for topic in graph if between_nodes]


class Flooder:
    """Child process of one flood; as a context manager, it kills the process on exit."""

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
        """Return whether the process has ended."""
        return self._process.poll() is not None

    def sent(self) -> int:
        """Return the number of messages; call it only after the end of the process.

        Raises:
            EnvironmentProblem: if the process failed.
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
    """Feed the graph and return its figures; see `graph_figures.figures_of`.

    Args:
        seconds: (s) measured time, after the graph has settled.
        kill: afterwards kill each process in turn, to measure its silence and the identities it keeps.
        flood_s: (s) duration of each flood of bad messages afterwards; 0 = none.

    Raises:
        UserError: with the output of a node that ended.
        EnvironmentProblem: if another graph runs in this ROS domain, or no skeletons arrive.
    """
    floods = floods_of(feed.rig.names[0], node_per_stage) if flood_s else []
    observation: Observation = played(
        feed, node_per_stage, lambda: _FaultPlayer(feed, seconds, kill, floods, flood_s)
    )
    return figures_of(observation)


class _FaultPlayer(Player):
    """Player that then kills processes and floods topics on request."""

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
        """Kill a process, and play until its successor has settled."""
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

    def _flood(self, processes: Processes, flood: Flood) -> FloodRecord:
        """Play during a flood of bad messages."""
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
        return FloodRecord(flood.title, messages, begun, ended)
