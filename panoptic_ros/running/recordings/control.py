"""Finds, starts and stops the standby recorders of all hosts."""

from __future__ import annotations

import os
import time
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.utilities import try_shutdown

from panoptic_ros.errors import EnvironmentProblem
from panoptic_ros.nodes.middleware.family import service_class
from panoptic_ros.nodes.middleware.runtime import start_ros
from panoptic_ros.running.processes.children import prepare_environment

SERVICE = "record"  # service of a recorder's node, of type std_srvs/SetBool
PREFIX = "recorder_"  # prefix of a recorder's node name; the host name follows
ANSWER_S = 10.0  # s, timeout for the answers of hosts
SETTLE_S = 0.5  # s before the first request; a host that has not discovered the client yet does not answer
AGAIN_S = 3.0  # s without an answer before a request is repeated


def ask_all(start: bool, patience_s: float = 3.0) -> list[tuple[str, bool, str]]:
    """Ask the recorders of all hosts to start or to stop.

    A recorder that does not answer is asked again. This is safe: a recorder that is already in the requested
    state also reports success.

    Args:
        start: True = start, False = stop.
        patience_s: time to search for recorders, s. The search takes up to `ANSWER_S` longer while no
            recorder has been found or an answer is missing.

    Returns:
        (node, success, message) of every recorder.

    Raises:
        EnvironmentProblem: if there is no recorder.
    """
    prepare_recording()
    start_ros([])
    node = rclpy.create_node("recording_control")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    kind = service_class("std_srvs/srv/SetBool")
    try:
        clients: dict[str, Any] = {}
        futures: dict[str, Any] = {}
        due: dict[str, float] = {}  # time of the next request to each host, s
        deadline = time.monotonic() + patience_s
        while (now := time.monotonic()) < deadline or (
            now < deadline + ANSWER_S and not (futures and all(f.done() for f in futures.values()))
        ):
            for name, kinds in node.get_service_names_and_types():  # includes hosts that are discovered late
                ours = name.endswith(f"/{SERVICE}") and name.split("/")[-2].startswith(PREFIX)
                if ours and kinds == ["std_srvs/srv/SetBool"] and name not in clients:
                    clients[name] = node.create_client(kind, name)
            for name, client in clients.items():
                if client.service_is_ready() and now >= due.setdefault(name, now + SETTLE_S):
                    if name not in futures or not futures[name].done():
                        futures[name] = client.call_async(kind.Request(data=start))
                        due[name] = now + AGAIN_S
            executor.spin_once(timeout_sec=0.05)
        if not futures:
            raise EnvironmentProblem(
                "no recorder is standing by: start `panoptic record --standby --out FOLDER` on every host"
            )
        return [_answer(name, future) for name, future in sorted(futures.items())]
    finally:
        executor.shutdown()
        node.destroy_node()
        try_shutdown()


def _answer(name: str, future: Any) -> tuple[str, bool, str]:
    host = name.split("/")[-2]
    if not future.done():
        return host, False, "no answer"
    answer = future.result()
    return host, bool(answer.success), str(answer.message)


def prepare_recording() -> None:
    """Let recordings and their control reach other hosts, unless the user has set another discovery range."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    prepare_environment()
