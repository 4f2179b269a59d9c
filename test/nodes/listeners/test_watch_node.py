"""What nodes tell of themselves on the live graph, and who listens."""

import captures
import pytest
from spinning import spin_until

rclpy = pytest.importorskip("rclpy")
from panoptic_ros.graph.flow import make_flow  # noqa: E402
from panoptic_ros.io.messages import to_message  # noqa: E402
from panoptic_ros.nodes.listeners.watch_node import WatchNode  # noqa: E402
from panoptic_ros.nodes.middleware.family import message_class, ros_messages  # noqa: E402
from panoptic_ros.nodes.middleware.quality import data_quality  # noqa: E402
from panoptic_ros.nodes.sources.statics_node import StaticsNode  # noqa: E402
from panoptic_ros.nodes.stages.stage_node import StageNode  # noqa: E402

pytestmark = pytest.mark.ros
VIEW = message_class("panoptic_msgs/msg/ViewDetections")


@pytest.fixture
def graph(executor):
    node = StageNode("sync", {"flow": "live", "window_s": 0.005, "deadline_s": 0.05})
    statics, watch = StaticsNode(captures.RIG, captures.SKELETON), WatchNode()
    tester = rclpy.create_node("tester")
    quality = data_quality(make_flow("live"))
    publishers = {n: tester.create_publisher(VIEW, f"{n}/detections", quality) for n in captures.RIG.names}
    for item in (node, statics, watch, tester):
        executor.add_node(item)
    spin_until(executor, lambda: all(p.get_subscription_count() for p in publishers.values()))
    return node, executor, publishers, watch


def test_a_camera_that_falls_silent_is_named_and_the_warning_clears(graph):
    _, executor, publishers, watch = graph
    silent = captures.RIG.names[-1]
    count = [0]

    def play(cameras):
        stamp = rclpy.clock.Clock().now().nanoseconds
        for camera in captures.RIG.cameras:
            if camera.name in cameras:
                view = captures.view(camera, count[0], stamp)
                publishers[camera.name].publish(to_message(view, ros_messages()))
        count[0] += 1
        for _ in range(12):
            executor.spin_once(timeout_sec=0.003)

    def trouble(name):
        play(cameras)
        return watch.told[name].trouble if name in watch.told else None

    cameras = captures.RIG.names
    spin_until(executor, lambda: trouble(f"sync: {silent} detections") == "")
    cameras = captures.RIG.names[:-1]
    spin_until(
        executor, lambda: f"no {silent} detections for" in (trouble(f"sync: {silent} detections") or "")
    )
    assert watch.told["sync"].values["waiting_for"] == f"{silent} detections"
    assert not watch.told[f"sync: {cameras[0]} detections"].trouble
    spin_until(executor, lambda: silent in (trouble("graph") or ""))
    cameras = captures.RIG.names
    spin_until(executor, lambda: trouble(f"sync: {silent} detections") == "")
    found = watch.told["sync"]
    assert found.values["state"] == "running" and float(found.values["latency_p50_ms"]) < 5000.0


def test_bytes_that_are_no_message_are_counted_and_the_node_lives(graph):
    node, executor, publishers, watch = graph
    camera = captures.RIG.names[0]
    for data in (b"", b"\x00\x01\x00\x00", b"\x00\x01\x00\x00" + b"\xff" * 64, bytes(4000)):
        publishers[camera].publish(data)
        for _ in range(3):
            executor.spin_once(timeout_sec=0.05)
    spin_until(executor, lambda: node.statistics["sync"].dropped["bad_message"] >= 3)
    spin_until(executor, lambda: watch.told[f"sync: {camera} detections"].values["bad"] != "0")
    assert node.healthy
