"""Recorders of all hosts that stand by: how they are found, started and stopped."""

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

SERVICE = "record"  # of a recorder's node, as std_srvs/SetBool
PREFIX = "recorder_"  # of the node's name; the host follows
ANSWER_S = 10.0  # for hosts that have been asked
SETTLE_S = 0.5  # a host that does not know its asker yet answers nobody
AGAIN_S = 3.0  # without an answer


def ask_all(start: bool, patience_s: float = 3.0) -> list[tuple[str, bool, str]]:
    """Ask the recorders of all hosts to start or to stop: (node, whether it is as wished, what it says).

    A host that does not answer is asked again: recorders answer the same to a wish that is fulfilled.

    Args:
        patience_s: how long to look for more hosts. The first one and all answers may take `ANSWER_S` more.

    Raises:
        EnvironmentProblem: if there are none.
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
        due: dict[str, float] = {}  # when a host is asked, for the first time or again
        deadline = time.monotonic() + patience_s
        while (now := time.monotonic()) < deadline or (
            now < deadline + ANSWER_S and not (futures and all(f.done() for f in futures.values()))
        ):
            for name, kinds in node.get_service_names_and_types():  # hosts found late are asked as well
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
    """Recordings and their control reach other hosts unless the user says otherwise."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    prepare_environment()
