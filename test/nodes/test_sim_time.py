"""Nodes on the time of a bag: people come at the bag's pace, and a dead camera is left out by its stamps."""
import subprocess
import sys
import time

import captures
import pytest
from recordings import write_bag

rclpy = pytest.importorskip("rclpy")

from panoptic_ros.graph.nodes import AFTER_DETECTION  # noqa: E402
from panoptic_ros.nodes.family import message_class  # noqa: E402
from panoptic_ros.nodes.stage_node import StageNode  # noqa: E402

pytestmark = pytest.mark.ros
FRAMES, DIES_AT = 75, 30


def replayed(bag, rate):
    words = ["replay", bag, "--from", "detections", "--clock", "--rate", rate, "--wait", 30]
    return subprocess.Popen([sys.executable, "-m", "panoptic_ros.cli.main", *map(str, words)])


@pytest.mark.parametrize("rate", [0.5, 4])
def test_a_live_graph_follows_the_clock_of_the_bag(executor, tmp_path, rate):
    views = [v for v in captures.views(FRAMES) if v.camera != "cam3" or v.frame_number < DIES_AT]
    node = StageNode(AFTER_DETECTION, {"use_sim_time": True, "flow": "live"}, name="fusion")
    tester = rclpy.create_node("tester")
    seen = []

    def take(message):
        stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        seen.append((stamp, node.get_clock().now().nanoseconds * 1e-9 - stamp, len(message.skeletons)))

    tester.create_subscription(message_class("panoptic_msgs/msg/Skeletons"), "skeletons", take, 100)
    executor.add_node(node)
    executor.add_node(tester)
    process = replayed(write_bag(tmp_path / "bag", views), rate)
    end = time.monotonic() + 120
    while process.poll() is None and time.monotonic() < end:
        executor.spin_once(timeout_sec=0.05)
    assert process.returncode == 0 and node.healthy
    stamps = [stamp for stamp, _, _ in seen]
    assert stamps == sorted(stamps) and len(seen) > 0.6 * FRAMES
    after = [people for stamp, _, people in seen if stamp > (DIES_AT + 25) / 30]
    assert len(after) > 5 and sum(people == 2 for people in after) > 0.8 * len(after)
