"""A run through real nodes: processes for cameras, detection and fusion, over DDS."""
from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

from panoptic_ros.cli.run.launch_file import write_launch_file
from panoptic_ros.cli.run.plan import Plan
from panoptic_ros.cli.run.results import Results
from panoptic_ros.errors import EnvironmentProblem
from panoptic_ros.graph.flow import make_flow
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.nodes.collector_node import CollectorNode
from panoptic_ros.nodes.processes import Processes, prepare_environment
from panoptic_ros.nodes.statics_node import StaticsNode

LAST_WORDS_S = 3.0  # how long to wait for the nodes' last diagnostics


def run_over_dds(
    plan: Plan, results: Results, stop: Callable[[], bool], jpeg_quality: int = 0
) -> dict[str, dict[str, str]]:
    """Run the plan to its end, or until `stop()` is true; returns each node's last diagnostics.

    Raises:
        UserError: as a node printed it, if one ended.
        EnvironmentProblem: if another graph publishes /skeletons already.
    """
    prepare_environment()
    flow_name = "live" if plan.live else "replay"
    window = 12 + math.ceil(plan.frame_rate * plan.configs["refinement"].lag)  # type: ignore[attr-defined]
    launch = write_launch_file(plan, results.folder, flow_name, window, jpeg_quality)
    rclpy.init(args=[])
    executor = SingleThreadedExecutor()
    collector = CollectorNode(make_flow(flow_name, window), plan.rig.names, results.take)
    statics = StaticsNode(plan.rig, plan.skeleton)
    try:
        _alone(collector)
        for node in (collector, statics):
            executor.add_node(node)
        document = json.loads(launch.read_text())
        logs = results.folder / "logs"
        with Processes(launch, document["processes"], logs) as processes:
            _spin(executor, collector, processes, stop)
            deadline = time.monotonic() + LAST_WORDS_S
            names = [entry["name"] for p in document["processes"].values() for entry in p if "name" in entry]
            while not plan.live and not collector.finished(names) and time.monotonic() < deadline:
                executor.spin_once(timeout_sec=0.1)
        return collector.diagnostics
    except ExternalShutdownException:
        raise KeyboardInterrupt from None
    finally:
        executor.shutdown()
        collector.destroy_node()
        statics.destroy_node()
        rclpy.try_shutdown()
        launch.unlink(missing_ok=True)


def _spin(executor: Any, collector: CollectorNode, processes: Processes, stop: Callable[[], bool]) -> None:
    looked = time.monotonic()
    while not collector.over and not stop():
        executor.spin_once(timeout_sec=0.1)
        if time.monotonic() - looked > 0.5:
            looked = time.monotonic()
            processes.check()


def _alone(node: CollectorNode) -> None:
    """Two graphs on the same topics would mix.

    Raises:
        EnvironmentProblem: if somebody publishes /skeletons already.
    """
    deadline = time.monotonic() + 1.0
    while time.monotonic() < deadline:
        if node.count_publishers(TOPICS["skeletons"].name):
            domain = os.environ.get("ROS_DOMAIN_ID", "0")
            raise EnvironmentProblem(
                f"another graph publishes /skeletons in ROS domain {domain}; stop it, or set ROS_DOMAIN_ID "
                "to another number"
            )
        time.sleep(0.1)
