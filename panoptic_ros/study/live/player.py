"""Play 2D poses to a live graph in other processes in real time, and record its skeletons."""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from rclpy.utilities import try_shutdown

from panoptic_ros.errors import EnvironmentProblem
from panoptic_ros.graph.flow import LIVE_DEFAULTS, WINDOW
from panoptic_ros.nodes.listeners.domain_claim import claim_domain, require_no_other_graph
from panoptic_ros.nodes.middleware.runtime import make_executor, start_ros
from panoptic_ros.nodes.sources.feeding_node import FeedingNode
from panoptic_ros.nodes.sources.statics_node import StaticsNode
from panoptic_ros.running.plans.parameters import with_defaults
from panoptic_ros.running.plans.plan import Plan
from panoptic_ros.running.processes.children import Processes, prepare_environment
from panoptic_ros.running.runs.launch import write_launch_file
from panoptic_ros.study.live.graph_feed import Feed

SETTLE_NS = 2_000_000_000  # time after the first skeletons in which latency is ignored
PATIENCE_S = 300.0  # timeout for the first skeletons; it includes the compilation of kernels
LAST_WORDS_S = 1.2  # wait for the last skeletons, and for diagnostics, which are published once a second


def as_it_is(plan: Plan, folder: Path) -> Plan:
    """Return the plan unchanged; the default of `played`."""
    return plan


def played(
    feed: Feed,
    node_per_stage: bool,
    make: Callable[[], Player],
    change: Callable[[Plan, Path], Plan] = as_it_is,
) -> Any:
    """Start a live graph, play to it, and return the result of the player's `do`.

    Args:
        change: changes the usual plan for a study; it may write files into the folder.

    Raises:
        UserError: with the output of a node that ended.
        EnvironmentProblem: if another graph runs in this ROS domain, or no skeletons arrive.
    """
    prepare_environment()
    configs = with_defaults({"refinement": {"lag": 0.0}}, {s: dict(v) for s, v in LIVE_DEFAULTS.items()})
    plan = Plan("bench", feed.rig, feed.skeleton, configs, stage="sync", frame_rate=feed.rate, live=True)
    with claim_domain(), tempfile.TemporaryDirectory(prefix="panoptic-bench-") as folder:
        plan = change(plan, Path(folder))
        launch = write_launch_file(plan, Path(folder), "live", WINDOW, 0, node_per_stage)
        start_ros([])
        try:
            return make().observe(launch)
        finally:
            try_shutdown()


class Player:
    """One run of a graph: the clock, and the messages sent and received so far.

    Args:
        revived: processes will be killed and restarted.
    """

    def __init__(self, feed: Feed, revived: bool):
        self.feed, self._revived = feed, revived
        self.number = 0  # index of the next time step
        self.newest: tuple[int, frozenset[int]] = (0, frozenset())  # timestamp and identities
        self.sent: list[tuple[int, int]] = []  # per time step: timestamp, publication time of the last view
        self.received: list[tuple[int, int]] = []
        self.away: set[str] = set()  # cameras that publish nothing
        self.node = FeedingNode(feed.rig.names, self._take, time.monotonic_ns)
        self._views = [
            [(offset, self.node.message_of(view)) for offset, view in feed.views(k)]
            for k in range(len(feed.sets))
        ]
        self._executor = make_executor()

    def observe(self, launch: Path) -> Any:
        """Start the processes, run `do`, and end the processes."""
        statics = StaticsNode(self.feed.rig, self.feed.skeleton)
        names = json.loads(launch.read_text())["processes"]
        try:
            require_no_other_graph(self.node)
            for node in (self.node, statics):
                self._executor.add_node(node)
            self.started = time.monotonic_ns()
            self.stamps_from = time.time_ns() - time.monotonic_ns()
            with Processes(launch, names, launch.parent / "logs", self._revived) as processes:
                return self.do(processes)
        finally:
            self._executor.shutdown()
            self.node.destroy_node()
            statics.destroy_node()

    def do(self, processes: Processes) -> Any:
        """Run the study while the processes run."""
        raise NotImplementedError

    def is_settled(self) -> bool:
        """Return whether skeletons have arrived for `SETTLE_NS`.

        Raises:
            EnvironmentProblem: if none arrive.
        """
        now = time.monotonic_ns()
        if not self.received and now > self.started + 1e9 * PATIENCE_S:
            raise EnvironmentProblem(f"the graph gave no skeletons within {PATIENCE_S:g} s")
        return bool(self.received) and now > self.received[0][1] + SETTLE_NS

    def play(self) -> None:
        """Publish the views of the next time step, each at its time."""
        due_ns = self.started + self.number * self.feed.period_ns
        last = due_ns
        for offset, message in self.messages(self.number):
            self.spin_until(due_ns + offset)
            if message.header.frame_id not in self.away:
                last = time.monotonic_ns()
                self.publish(message, self.stamps_from + due_ns + offset)
        self.sent.append((self.stamps_from + due_ns, last))
        self.number += 1

    def messages(self, number: int) -> Sequence[tuple[int, Any]]:
        """Return the messages of a time step with their delays (ns), in order of time."""
        return self._views[self.feed.number_of_set(number)]

    def publish(self, message: Any, stamp_ns: int) -> None:
        """Publish a message of this time step."""
        self.node.publish(message, stamp_ns, self.number)

    def play_until(self, moment_ns: int) -> None:
        """Play until this time of the monotonic clock (ns)."""
        while time.monotonic_ns() < moment_ns:
            self.play()

    def spin_until(self, moment_ns: int) -> None:
        """Process incoming messages until this time of the monotonic clock (ns)."""
        while (left := moment_ns - time.monotonic_ns()) > 0:
            self._executor.spin_once(timeout_sec=1e-9 * left)

    def _take(self, stamp_ns: int, when_ns: int, ids: frozenset[int]) -> None:
        self.received.append((stamp_ns, when_ns))
        self.newest = stamp_ns, ids
        self.took(stamp_ns, when_ns, ids)

    def took(self, stamp_ns: int, when_ns: int, ids: frozenset[int]) -> None:
        """Handle new skeletons; subclasses override it."""
