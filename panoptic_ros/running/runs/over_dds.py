"""Runs a plan through ROS nodes over DDS, in processes for cameras, detection and fusion."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from rclpy.utilities import try_shutdown

from panoptic_ros.graph.flow import make_flow
from panoptic_ros.io.interruption import first_request_told
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.nodes.listeners.collector_node import CollectorNode
from panoptic_ros.nodes.listeners.domain_claim import claim_domain
from panoptic_ros.nodes.middleware.runtime import in_namespace, make_executor, start_ros
from panoptic_ros.nodes.sources.statics_node import StaticsNode
from panoptic_ros.params import config_of
from panoptic_ros.running.plans.plan import Plan
from panoptic_ros.running.processes.children import (
    NOBODY_AHEAD,
    LaunchPreparation,
    Processes,
    prepare_environment,
)
from panoptic_ros.running.runs.launch import flow_of, write_launch_file
from panoptic_ros.running.runs.listening import require_no_other_graph
from panoptic_ros.running.runs.results import Results, check_record, kept_besides

LOOK_S = 0.2  # s between two checks that all processes run
LAST_WORDS_S = 3.0  # s, timeout for the last diagnostics of the nodes


def run_over_dds(
    plan: Plan,
    results: Results,
    stop: Callable[[], bool],
    jpeg_quality: int = 0,
    node_per_stage: bool = False,
    ahead: LaunchPreparation = NOBODY_AHEAD,
) -> dict[str, dict[str, str]]:
    """Run the plan until its end or until `stop()` is true; return the last diagnostics of each node.

    Raises:
        UserError: the error that a node printed, if a node ended.
        EnvironmentProblem: if another graph runs in this ROS domain.
    """
    prepare_environment()
    arguments = in_namespace(plan.namespace)
    with claim_domain(plan.namespace.strip("/")):
        return _run(plan, results, stop, jpeg_quality, node_per_stage, arguments, ahead)


def _run(
    plan: Plan,
    results: Results,
    stop: Callable[[], bool],
    jpeg_quality: int,
    node_per_stage: bool,
    arguments: list[str],
    ahead: LaunchPreparation,
) -> dict[str, dict[str, str]]:
    require_no_other_graph(ahead, plan.namespace)  # before this process publishes anything
    flow_name, window = flow_of(plan)
    launch = write_launch_file(plan, results.folder, flow_name, window, jpeg_quality, node_per_stage)
    document = json.loads(launch.read_text())
    names = [name for nodes in document["processes"].values() for node in nodes for name in _told_of(node)]
    start_ros(arguments)
    executor = make_executor()
    bodies = plan.imu_devices if config_of(plan.configs, KinematicsConfig).runs else None
    flow = make_flow(flow_name, window)
    nodes: list[Any] = []
    try:
        with Processes(launch, document["processes"], results.folder / "logs", plan.live, ahead) as processes:
            try:  # the processes create their nodes meanwhile; they wait for the rig, so it is published last
                collector = CollectorNode(
                    flow,
                    plan.rig.names,
                    results.take,
                    plan.devices,
                    bodies,
                    kept_besides(plan),
                    partial(check_record, plan),
                )
                nodes += [collector]
                nodes += [StaticsNode(plan.rig, plan.skeleton, live=plan.live)]
                for node in nodes:
                    executor.add_node(node)
                if plan.live:
                    _spin(executor, collector, processes, stop, live=True)
                else:
                    _replay(executor, collector, processes, stop, names)
                processes.ask_to_end()  # the processes need half a second to end, as does the code below
            finally:
                executor.shutdown()
                for node in nodes:
                    node.destroy_node()
                try_shutdown()
        return collector.diagnostics
    finally:
        launch.unlink(missing_ok=True)


def _replay(
    executor: Any, collector: CollectorNode, processes: Processes, stop: Callable[[], bool], names: list[str]
) -> None:
    """Spin until all records have arrived, then until the last diagnostics of the named nodes.

    A request to end takes effect between callbacks. Within a callback, the executor would report it as an
    error.
    """
    with first_request_told() as asked:
        _spin(executor, collector, processes, lambda: asked() or stop(), live=False)
        deadline = time.monotonic() + LAST_WORDS_S
        while not asked() and not collector.finished(names) and time.monotonic() < deadline:
            executor.spin_once(timeout_sec=0.1)
        if asked():
            raise KeyboardInterrupt


def _told_of(node: Mapping[str, Any]) -> list[str]:
    """Return the names that a node of the launch file has on /diagnostics.

    A node with several stages appears under the names of its stages.
    """
    stages = node.get("stages", [])
    return list(stages) if len(stages) > 1 else [node["name"]] if "name" in node else []


def _spin(
    executor: Any, collector: CollectorNode, processes: Processes, stop: Callable[[], bool], live: bool
) -> None:
    """Spin until the end. In a live run, restart processes that were killed."""
    looked = time.monotonic()
    while not collector.over and not stop():
        executor.spin_once(timeout_sec=0.1)
        if time.monotonic() - looked > LOOK_S:
            looked = time.monotonic()
            if live:
                for line in processes.revive():
                    collector.get_logger().warning(line)
            else:
                processes.check()
