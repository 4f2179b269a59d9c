"""Graphs in one domain do not hear each other: a node takes what comes in its namespace, and tells of it."""

import captures
import pytest
from spinning import spin_until

rclpy = pytest.importorskip("rclpy")
from rclpy.executors import SingleThreadedExecutor  # noqa: E402

from panoptic_ros.graph.flow import make_flow  # noqa: E402
from panoptic_ros.io.messages import from_message, to_message  # noqa: E402
from panoptic_ros.nodes.health.diagnostics import own_statuses  # noqa: E402
from panoptic_ros.nodes.middleware.family import message_class, ros_messages  # noqa: E402
from panoptic_ros.nodes.middleware.quality import data_quality  # noqa: E402
from panoptic_ros.nodes.middleware.runtime import in_namespace  # noqa: E402
from panoptic_ros.nodes.sources.statics_node import StaticsNode  # noqa: E402
from panoptic_ros.nodes.stages.stage_node import StageNode  # noqa: E402

pytestmark = pytest.mark.ros
VIEW = message_class("panoptic_msgs/msg/ViewDetections")
SET = message_class("panoptic_msgs/msg/DetectionSet")
STATUS = message_class("diagnostic_msgs/msg/DiagnosticArray")


@pytest.fixture
def lab():
    """An executor whose process is in the namespace /lab."""
    rclpy.init(args=in_namespace("lab"))
    executor = SingleThreadedExecutor()
    yield executor
    for node in executor.get_nodes():
        if hasattr(node, "close"):
            node.close()
        node.destroy_node()
    executor.shutdown()
    rclpy.try_shutdown()


def test_two_graphs_in_one_domain(lab):
    node = StageNode("sync", {"flow": "live", "window_s": 0.005, "deadline_s": 0.05})
    tester = rclpy.create_node("tester", namespace="hall", use_global_arguments=False)
    for item in (node, StaticsNode(captures.RIG, captures.SKELETON), tester):
        lab.add_node(item)
    quality = data_quality(make_flow("live"))
    publishers = {
        (graph, name): tester.create_publisher(VIEW, f"/{graph}/{name}/detections", quality)
        for graph in ("hall", "lab")
        for name in captures.RIG.names
    }
    sets, told = {"hall": [], "lab": []}, []
    for graph, found in sets.items():
        tester.create_subscription(SET, f"/{graph}/detection_sets", found.append, 10)
    tester.create_subscription(STATUS, "/diagnostics", told.append, 10)
    spin_until(lab, lambda: all(p.get_subscription_count() for (g, _), p in publishers.items() if g == "lab"))
    for _ in range(10):
        lab.spin_once(timeout_sec=0.05)

    def send(graph, index):
        for camera in captures.RIG.cameras:
            view = captures.view(camera, index, round(index * 1e9 / 30))
            publishers[graph, camera.name].publish(to_message(view, ros_messages()))
        for _ in range(6):
            lab.spin_once(timeout_sec=0.05)

    for index in range(1, 6):
        send("hall", 100 + index)
        send("lab", index)
    spin_until(lab, lambda: len(sets["lab"]) >= 4 and told)
    frames = {v.frame_number for s in sets["lab"] for v in from_message(s, "DetectionSet").views}
    assert not sets["hall"] and max(frames) < 100
    statuses = {graph: [n for m in told for n, _ in own_statuses(m, f"/{graph}")] for graph in sets}
    assert "sync" in statuses["lab"] and not statuses["hall"]
