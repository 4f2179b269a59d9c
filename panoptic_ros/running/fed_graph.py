"""The live graph after detection in processes of its own, fed from this one, and what is seen of it."""
from __future__ import annotations

import json
import tempfile
import time
from pathlib import Path
from typing import Any

from rclpy.executors import SingleThreadedExecutor
from rclpy.utilities import try_shutdown

from panoptic_ros.bench.graph_feed import Feed
from panoptic_ros.bench.graph_figures import Observation, Usage, figures_of
from panoptic_ros.errors import EnvironmentProblem
from panoptic_ros.graph.flow import LIVE_DEFAULTS, WINDOW
from panoptic_ros.nodes.domain_claim import claim_domain, require_no_other_graph
from panoptic_ros.nodes.feeding_node import FeedingNode
from panoptic_ros.nodes.runtime import start_ros
from panoptic_ros.nodes.statics_node import StaticsNode
from panoptic_ros.running.launch_file import write_launch_file
from panoptic_ros.running.parameters import with_defaults
from panoptic_ros.running.plan import Plan
from panoptic_ros.running.processes import Processes, prepare_environment
from panoptic_ros.running.usage import usage_of

SETTLE_NS = 2_000_000_000  # from the first skeletons on, latencies do not count so long
PATIENCE_S = 300.0  # for the first skeletons: kernels may be compiled
LAST_WORDS_S = 1.2  # for the last skeletons, and for diagnostics, which come once a second


def run_fed_graph(feed: Feed, seconds: float, node_per_stage: bool) -> dict[str, Any]:
    """Feed the graph until skeletons have come for so long; see `bench.graph_figures.figures_of`.

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
            return figures_of(_Run(feed, seconds).observe(launch))
        finally:
            try_shutdown()


class _Run:
    """One run: the clock, and what was sent and received so far."""

    def __init__(self, feed: Feed, seconds: float):
        self._feed, self._seconds = feed, seconds
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
            with Processes(launch, names, launch.parent / "logs") as processes:
                return self._observe(processes, started)
        finally:
            self._executor.shutdown()
            self._node.destroy_node()
            statics.destroy_node()

    def _observe(self, processes: Processes, started: int) -> Observation:
        stamps_from = time.time_ns() - time.monotonic_ns()
        ids = processes.ids
        before: Usage | None = None
        number = 0
        while before is None or time.monotonic_ns() < before.at_ns + 1e9 * self._seconds:
            self._play(number, started + number * self._feed.period_ns, stamps_from)
            if number % 15 == 0:
                processes.check()
            if before is None and self._is_settled(started):
                before = usage_of(ids)
            number += 1
        after = usage_of(ids)
        self._spin_until(time.monotonic_ns() + round(1e9 * LAST_WORDS_S))
        return Observation(
            self._sent, self._received, self._feed.period_ns, started, before.at_ns, before, after,
            self._node.diagnostics,
        )  # fmt: skip

    def _is_settled(self, started: int) -> bool:
        now = time.monotonic_ns()
        if not self._received and now > started + 1e9 * PATIENCE_S:
            raise EnvironmentProblem(f"the graph gave no skeletons within {PATIENCE_S:g} s")
        return bool(self._received) and now > self._received[0][1] + SETTLE_NS

    def _play(self, number: int, due_ns: int, stamps_from: int) -> None:
        """Publish the views of an instant, each at its time."""
        views = self._views[self._feed.number_of_set(number)]
        for offset, message in views:
            self._spin_until(due_ns + offset)
            last = time.monotonic_ns()
            self._node.publish(message, stamps_from + due_ns + offset, number)
        self._sent.append((stamps_from + due_ns, last))

    def _spin_until(self, moment_ns: int) -> None:
        while (left := moment_ns - time.monotonic_ns()) > 0:
            self._executor.spin_once(timeout_sec=1e-9 * left)

    def _take(self, stamp_ns: int, when_ns: int) -> None:
        self._received.append((stamp_ns, when_ns))
