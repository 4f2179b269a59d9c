"""Run the whole live graph in child processes, with recordings played as cameras, and observe it."""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.executors import SingleThreadedExecutor
from rclpy.utilities import try_shutdown

from panoptic_ros.errors import EnvironmentProblem
from panoptic_ros.graph.flow import WINDOW
from panoptic_ros.nodes.listeners.domain_claim import claim_domain, require_no_other_graph
from panoptic_ros.nodes.middleware.runtime import start_ros
from panoptic_ros.nodes.sources.feeding_node import FeedingNode
from panoptic_ros.nodes.sources.statics_node import StaticsNode
from panoptic_ros.running.plans.plan import Plan
from panoptic_ros.running.processes.children import Processes, prepare_environment
from panoptic_ros.running.processes.usage import Usage, usage_of
from panoptic_ros.running.runs.launch import write_launch_file
from panoptic_ros.study.live.graph_figures import Observation, figures_of

PATIENCE_S = 300.0  # timeout for the first skeletons
LOOK_S = 1.0  # interval of the check that all processes run
LAST_WORDS_S = 1.5  # wait for the last skeletons, and for diagnostics, which are published once a second


@dataclass(frozen=True)
class _UsageSample:
    """Resource usage at a time: of all processes, and processor time (s) by stage and camera."""

    usage: Usage
    cpu_s: Mapping[str, float]
    at_ns: int


def run_played_graph(plan: Plan, seconds: float, settle_s: float) -> dict[str, Any]:
    """Run a live plan and return its figures; see `graph_figures.figures_of`.

    Latency is measured from the timestamp of a time step to the arrival of its skeletons in this process.

    Args:
        seconds: measured time (s).
        settle_s: time (s) from the first skeletons to the measured time.

    Returns:
        the figures and "cpu_ms". It has the processor time per time step of each stage, of reading the
        cameras, and of the rest of all processes.

    Raises:
        UserError: with the output of a node that ended.
        EnvironmentProblem: if another graph runs in this ROS domain, or no skeletons arrive.
    """
    prepare_environment()
    with claim_domain(), tempfile.TemporaryDirectory(prefix="panoptic-bench-") as folder:
        launch = write_launch_file(plan, Path(folder), "live", WINDOW, 0)
        start_ros([])
        try:
            return _Listener(plan).observe(launch, seconds, settle_s)
        finally:
            try_shutdown()


class _Listener:
    def __init__(self, plan: Plan):
        self._plan = plan
        self._received: list[tuple[int, int]] = []
        self._people: list[tuple[int, int]] = []  # arrival time (ns), number of persons
        self._node = FeedingNode((), self._take, time.time_ns)
        self._executor = SingleThreadedExecutor()

    def observe(self, launch: Path, seconds: float, settle_s: float) -> dict[str, Any]:
        statics = StaticsNode(self._plan.rig, self._plan.skeleton)
        names = json.loads(launch.read_text())["processes"]
        try:
            require_no_other_graph(self._node)
            for node in (self._node, statics):
                self._executor.add_node(node)
            started = time.time_ns()
            with Processes(launch, names, launch.parent / "logs") as processes:
                self._wait_for_first(processes, started)
                self._spin(processes, settle_s)
                before = self._measure(processes)
                self._spin(processes, seconds)
                after = self._measure(processes)
                self._spin(processes, LAST_WORDS_S)
            return self._figures(started, before, after)
        finally:
            self._executor.shutdown()
            self._node.destroy_node()
            statics.destroy_node()

    def _take(self, stamp_ns: int, when_ns: int, ids: frozenset[int]) -> None:
        self._received.append((stamp_ns, when_ns))
        self._people.append((when_ns, len(ids)))

    def _wait_for_first(self, processes: Processes, started: int) -> None:
        while not self._received:
            self._spin(processes, 0.1)
            if time.time_ns() > started + 1e9 * PATIENCE_S:
                raise EnvironmentProblem(f"the graph gave no skeletons within {PATIENCE_S:g} s")

    def _spin(self, processes: Processes, seconds: float) -> None:
        end, look = time.monotonic() + seconds, 0.0
        while (now := time.monotonic()) < end:
            if now >= look:
                processes.check()
                look = now + LOOK_S
            self._executor.spin_once(timeout_sec=min(0.1, end - now))

    def _measure(self, processes: Processes) -> _UsageSample:
        told = self._node.diagnostics
        used = {name: float(values["cpu_s"]) for name, values in told.items() if "cpu_s" in values}
        return _UsageSample(usage_of(processes.ids), used, time.time_ns())

    def _figures(self, started: int, before: _UsageSample, after: _UsageSample) -> dict[str, Any]:
        own = next(iter(self._plan.sources.values()))
        begin, period = int(own["start_ns"]), 1e9 / float(own["rate_hz"])
        first, last = ((moment - begin) / period for moment in (before.at_ns, after.at_ns))
        stamps = [begin + round(n * period) for n in range(int(first) + 1, int(last) + 1)]
        stages = {name: values for name, values in self._node.diagnostics.items() if ":" not in name}
        seen = Observation(
            [(stamp, stamp) for stamp in stamps],
            self._received,
            round(period),
            started,
            before.at_ns,
            before.usage,
            after.usage,
            stages,
        )
        per_instant = 1e3 / max(len(stamps), 1)
        spent = {name: s - before.cpu_s.get(name, 0.0) for name, s in after.cpu_s.items()}
        by_stage = {name: per_instant * s for name, s in spent.items() if ":" not in name}
        cameras = per_instant * sum(s for name, s in spent.items() if ":" in name)
        whole = per_instant * (after.usage.cpu_s - before.usage.cpu_s)
        rest = whole - cameras - sum(by_stage.values())
        cpu_ms = {"reading cameras": cameras, **by_stage, "messages and the rest": rest}
        return {
            **figures_of(seen),
            "cpu_ms": cpu_ms,
            "people": float(np.mean([number for when, number in self._people if when > before.at_ns] or [0])),
            "chosen": {
                name.removeprefix("told."): text
                for values in stages.values()
                for name, text in values.items()
                if name.startswith("told.detection.")
            },
        }
