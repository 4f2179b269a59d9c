"""The live graph after detection in processes of its own, fed from this one, and what is seen of it."""
from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rclpy.executors import SingleThreadedExecutor
from rclpy.utilities import try_shutdown

from panoptic_ros.bench.graph_feed import Feed
from panoptic_ros.bench.graph_figures import Flooded, Observation, Restart, Usage, figures_of
from panoptic_ros.errors import EnvironmentProblem
from panoptic_ros.graph.flow import LIVE_DEFAULTS, WINDOW
from panoptic_ros.nodes.domain_claim import claim_domain, require_no_other_graph
from panoptic_ros.nodes.feeding_node import FeedingNode
from panoptic_ros.nodes.runtime import start_ros
from panoptic_ros.nodes.statics_node import StaticsNode
from panoptic_ros.running.flooding import Flood, Flooder, floods_of
from panoptic_ros.running.launch_file import write_launch_file
from panoptic_ros.running.parameters import with_defaults
from panoptic_ros.running.plan import Plan
from panoptic_ros.running.processes import Processes, prepare_environment
from panoptic_ros.running.usage import usage_of

SETTLE_NS = 2_000_000_000  # from the first skeletons on, latencies do not count so long
PATIENCE_S = 300.0  # for the first skeletons: kernels may be compiled
RESTART_PATIENCE_S = 60.0  # for skeletons after a process was killed
LAST_WORDS_S = 1.2  # for the last skeletons, and for diagnostics, which come once a second


def run_fed_graph(
    feed: Feed, seconds: float, node_per_stage: bool, kill: bool = False, flood_s: float = 0.0
) -> dict[str, Any]:
    """Feed the graph until skeletons have come for so long; see `bench.graph_figures.figures_of`.

    Args:
        kill: afterwards kill each process in turn, to see how long it is silent and whom it still knows.
        flood_s: afterwards send floods of bad messages, each for so long; 0: none.

    Raises:
        UserError: as a node printed it, if one ended.
        EnvironmentProblem: if another graph runs in this ROS domain, or no skeletons come.
    """
    prepare_environment()
    configs = with_defaults({"refinement": {"lag": 0.0}}, {s: dict(v) for s, v in LIVE_DEFAULTS.items()})
    plan = Plan("bench", feed.rig, feed.skeleton, configs, stage="sync", frame_rate=feed.rate, live=True)
    with claim_domain(), tempfile.TemporaryDirectory(prefix="panoptic-bench-") as folder:
        launch = write_launch_file(plan, Path(folder), "live", WINDOW, 0, node_per_stage)
        start_ros([])
        try:
            floods = floods_of(feed.rig.names[0], node_per_stage) if flood_s else []
            return figures_of(_Run(feed, seconds, kill, floods, flood_s).observe(launch))
        finally:
            try_shutdown()


class _Run:
    """One run: the clock, and what was sent and received so far."""

    def __init__(self, feed: Feed, seconds: float, kill: bool, floods: Sequence[Flood], flood_s: float):
        self._feed, self._seconds, self._kill = feed, seconds, kill
        self._floods, self._flood_s = floods, flood_s
        self._number = 0  # of the next instant
        self._newest: tuple[int, frozenset[int]] = (0, frozenset())  # stamp and identities
        self._sent: list[tuple[int, int]] = []
        self._received: list[tuple[int, int]] = []
        self._node = FeedingNode(feed.rig.names, self._take, time.monotonic_ns)
        self._views = [
            [(offset, self._node.message_of(view)) for offset, view in feed.views(k)]
            for k in range(len(feed.sets))
        ]
        self._executor = SingleThreadedExecutor()

    def observe(self, launch: Path) -> Observation:
        """Start the processes, feed them, and end them."""
        statics = StaticsNode(self._feed.rig, self._feed.skeleton)
        names = json.loads(launch.read_text())["processes"]
        try:
            require_no_other_graph(self._node)
            for node in (self._node, statics):
                self._executor.add_node(node)
            started = time.monotonic_ns()
            with Processes(launch, names, launch.parent / "logs", self._kill) as processes:
                return self._observe(processes, started)
        finally:
            self._executor.shutdown()
            self._node.destroy_node()
            statics.destroy_node()

    def _observe(self, processes: Processes, started: int) -> Observation:
        self._started, self._stamps_from = started, time.time_ns() - time.monotonic_ns()
        ids = processes.ids
        before: Usage | None = None
        while before is None or time.monotonic_ns() < before.at_ns + 1e9 * self._seconds:
            self._play()
            if self._number % 15 == 0:
                processes.check()
            if before is None and self._is_settled(started):
                before = usage_of(ids)
        after = usage_of(ids)
        sent = list(self._sent)
        restarts = [self._restart(processes, name) for name in processes.names] if self._kill else []
        floods = [self._flood(processes, flood) for flood in self._floods]
        if floods:
            sent = list(self._sent)
        self._spin_until(time.monotonic_ns() + round(1e9 * LAST_WORDS_S))
        return Observation(
            sent, self._received, self._feed.period_ns, started, before.at_ns, before, after,
            self._node.diagnostics, restarts, floods,
        )  # fmt: skip

    def _restart(self, processes: Processes, name: str) -> Restart:
        """Kill a process, and play on until its successor has settled."""
        self._play_until(time.monotonic_ns() + SETTLE_NS)
        _, before = self._newest
        killed = time.monotonic_ns()
        since, back = self._stamps_from + killed, None
        processes.kill(name)
        while back is None and time.monotonic_ns() < killed + 1e9 * RESTART_PATIENCE_S:
            self._play()
            processes.revive()
            back = next((when for stamp, when in reversed(self._received) if stamp > since), None)
        self._play_until(time.monotonic_ns() + SETTLE_NS)
        came = [when for stamp, when in self._received if stamp > since]
        silence_s = 1e-9 * (min(came) - killed) if came else None
        return Restart(name, silence_s, before, self._newest[1])

    def _flood(self, processes: Processes, flood: Flood) -> Flooded:
        """Play on while bad messages come."""
        self._play_until(time.monotonic_ns() + SETTLE_NS)
        begun = time.monotonic_ns()
        with Flooder(flood, self._flood_s) as flooder:
            while not flooder.over:
                self._play()
                if self._number % 15 == 0:
                    processes.check()
            messages = flooder.sent()
        ended = self._sent[-1][1]
        self._play_until(time.monotonic_ns() + SETTLE_NS)
        return Flooded(flood.title, messages, begun, ended)

    def _is_settled(self, started: int) -> bool:
        now = time.monotonic_ns()
        if not self._received and now > started + 1e9 * PATIENCE_S:
            raise EnvironmentProblem(f"the graph gave no skeletons within {PATIENCE_S:g} s")
        return bool(self._received) and now > self._received[0][1] + SETTLE_NS

    def _play(self) -> None:
        """Publish the views of the next instant, each at its time."""
        number = self._number
        due_ns = self._started + number * self._feed.period_ns
        for offset, message in self._views[self._feed.number_of_set(number)]:
            self._spin_until(due_ns + offset)
            last = time.monotonic_ns()
            self._node.publish(message, self._stamps_from + due_ns + offset, number)
        self._sent.append((self._stamps_from + due_ns, last))
        self._number += 1

    def _play_until(self, moment_ns: int) -> None:
        while time.monotonic_ns() < moment_ns:
            self._play()

    def _spin_until(self, moment_ns: int) -> None:
        while (left := moment_ns - time.monotonic_ns()) > 0:
            self._executor.spin_once(timeout_sec=1e-9 * left)

    def _take(self, stamp_ns: int, when_ns: int, ids: frozenset[int]) -> None:
        self._received.append((stamp_ns, when_ns))
        self._newest = stamp_ns, ids
