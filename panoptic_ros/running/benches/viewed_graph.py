"""A live graph that people look at: what that costs it, and what they get."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from rclpy.executors import SingleThreadedExecutor
from rclpy.utilities import try_shutdown

from panoptic_ros.bench.view_feed import ViewInstant
from panoptic_ros.domain import Rig, SkeletonModel
from panoptic_ros.nodes.domain_claim import claim_domain, require_no_other_graph
from panoptic_ros.nodes.runtime import start_ros
from panoptic_ros.nodes.statics_node import StaticsNode
from panoptic_ros.nodes.view_load_node import ViewLoadNode
from panoptic_ros.running.processes.children import child_environment, prepare_environment
from panoptic_ros.running.processes.usage import usage_of
from panoptic_ros.running.viewer.process import viewer
from panoptic_ros.view.page.clients import WARM_S


def run_viewed_graph(
    rig: Rig, skeleton: SkeletonModel, instants: Sequence[ViewInstant], rate_hz: float, seconds: float,
    audiences: Sequence[tuple[str, Sequence[str]]],
) -> list[dict[str, Any]]:  # fmt: skip
    """Play instants in front of one audience after the other.

    Args:
        audiences: names, and kinds of clients as in `view.page.clients`.

    Returns:
        for each audience: the latency of /skeletons and how many were lost, what publishing took, processor
        time and memory of the viewer, and what its clients got.

    Raises:
        EnvironmentProblem: if another graph runs in this ROS domain, or the viewer does not start.
    """
    prepare_environment()
    with claim_domain():
        start_ros([])
        statics, executor = StaticsNode(rig, skeleton), SingleThreadedExecutor()
        require_no_other_graph(statics)
        node = ViewLoadNode({"skeletons": [""], "detections": rig.names, "preview": rig.names})
        try:
            for each in (node, statics):
                executor.add_node(each)
            with viewer(["--live"]) as (process, address):
                player = _Player(node, executor, instants, rate_hz)
                player.play(2.0)  # until all have found each other
                return [player.phase(name, kinds, process, address, seconds) for name, kinds in audiences]
        finally:
            executor.shutdown()
            node.destroy_node()
            statics.destroy_node()
            try_shutdown()


class _Player:
    """Plays instants in real time."""

    def __init__(
        self, node: ViewLoadNode, executor: Any, instants: Sequence[ViewInstant], rate_hz: float
    ):
        self._node, self._executor, self._period_s = node, executor, 1.0 / rate_hz
        self._number = 0
        self._messages = [
            [
                *(("preview", item.camera, node.message_of(item)) for item in instant.previews),
                *(("detections", item.camera, node.message_of(item)) for item in instant.views),
                ("skeletons", "", node.message_of(instant.skeletons)),
            ]
            for instant in instants
        ]

    def play(self, seconds: float) -> None:
        """Publish instants for so long."""
        due, until = time.monotonic(), time.monotonic() + seconds
        while due < until:
            last = len(self._messages) - 1
            stamp = time.time_ns()
            for key, owner, message in self._messages[last - abs(last - self._number % (2 * last))]:
                self._node.publish(key, owner, message, stamp, self._number)
            self._number += 1
            due += self._period_s
            while (left := due - time.monotonic()) > 0:
                self._executor.spin_once(timeout_sec=left)

    def phase(
        self, name: str, kinds: Sequence[str], process: int, address: str, seconds: float
    ) -> dict[str, Any]:
        """Play before an audience, and tell what came of it."""
        command = [sys.executable, "-m", "panoptic_ros.view.page.clients", address, str(seconds), *kinds]
        clients = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=child_environment())
        self.play(WARM_S)
        node, before = self._node, usage_of([process])
        for log in (node.published, node.sent, node.heard):
            log.clear()
        self.play(seconds)
        after = usage_of([process])
        sent, heard, published = set(node.sent), list(node.heard), list(node.published)
        self.play(0.5)
        came = {stamp for stamp, _ in node.heard}
        while clients.poll() is None:
            self.play(0.2)
        assert clients.stdout is not None
        rows = json.loads(clients.stdout.read())
        clients.stdout.close()
        ages = [age for _, age in heard]
        wall_s = 1e-9 * (after.at_ns - before.at_ns)
        return {
            "audience": name, "clients": rows, "lost": len(sent - came),
            "skeletons_p50_ms": float(np.percentile(ages, 50)),
            "skeletons_p99_ms": float(np.percentile(ages, 99)),
            "publish_p50_ms": float(np.percentile(published, 50)),
            "publish_p99_ms": float(np.percentile(published, 99)),
            "viewer_cpu_percent": 100.0 * (after.cpu_s - before.cpu_s) / wall_s,
            "viewer_mb": after.resident_mb,
        }  # fmt: skip
