"""A first step that takes long is explained once; a worker tells how long it has been busy."""
import threading
import time

import pytest

rclpy = pytest.importorskip("rclpy")

from panoptic_ros.graph.counters import StageStatistics  # noqa: E402
from panoptic_ros.graph.queues import InOrder  # noqa: E402
from panoptic_ros.nodes.diagnostics import PATIENCE_S, Diagnostics  # noqa: E402
from panoptic_ros.nodes.worker import Worker  # noqa: E402

pytestmark = pytest.mark.ros


def test_a_long_first_step_is_explained_once(ros, capfd):
    node, statistics = rclpy.create_node("patient"), StageStatistics()
    diagnostics = Diagnostics(node, {"stage": statistics})
    diagnostics.publish()
    assert "kernels" not in capfd.readouterr().err
    diagnostics.busy_s = lambda: PATIENCE_S + 1
    diagnostics.publish()
    diagnostics.publish()
    assert capfd.readouterr().err.count("kernels") == 1
    node.destroy_node()


def test_worker_tells_how_long_it_is_busy():
    release = threading.Event()
    worker = Worker(lambda item: release.wait(10.0), lambda count: None)
    assert worker.busy_s == 0.0
    worker.start(InOrder())
    worker.put("a", 0, "item")
    deadline = time.monotonic() + 10.0
    while not worker.busy_s and time.monotonic() < deadline:
        time.sleep(0.01)
    assert worker.busy_s > 0.0
    release.set()
    while worker.busy_s and time.monotonic() < deadline:
        time.sleep(0.01)
    assert worker.busy_s == 0.0
    worker.stop()
