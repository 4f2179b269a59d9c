"""Nodes on the time of a bag: people come at the bag's pace, and a dead camera is left out by its stamps."""

import subprocess
import sys
import time
from dataclasses import replace

import captures
import pytest
from recordings import write_bag

rclpy = pytest.importorskip("rclpy")

from panoptic_ros.graph.nodes import AFTER_DETECTION  # noqa: E402
from panoptic_ros.nodes.middleware.family import message_class  # noqa: E402
from panoptic_ros.nodes.stages.stage_node import StageNode  # noqa: E402

pytestmark = pytest.mark.ros
FRAMES, DIES_AT = 75, 30


def replayed(bag, rate):
    words = ["replay", bag, "--from", "detections", "--clock", "--rate", rate, "--wait", 30]
    return subprocess.Popen([sys.executable, "-m", "panoptic_ros.cli.main", *map(str, words)])


@pytest.mark.parametrize("rate", [0.5, 4])
def test_a_live_graph_follows_the_clock_of_the_bag(executor, tmp_path, rate):
    period = max(1, round(rate)) / 30  # by the bag's clock: no more than 30 instants in a real second
    views = [
        replace(view, stamp_ns=round(1e9 * period * view.frame_number))
        for view in captures.views(FRAMES)
        if view.camera != "cam3" or view.frame_number < DIES_AT
    ]
    node = StageNode(AFTER_DETECTION, {"use_sim_time": True, "flow": "live"}, name="fusion")
    tester = rclpy.create_node("tester")
    seen = []

    def take(message):
        seen.append((message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec, len(message.skeletons)))

    tester.create_subscription(message_class("panoptic_msgs/msg/Skeletons"), "skeletons", take, 100)
    executor.add_node(node)
    executor.add_node(tester)
    process = replayed(write_bag(tmp_path / "bag", views), rate)
    end, counted = time.monotonic() + 120, node.statistics["sync"]
    before, quiet = -1, 0
    while (process.poll() is None or quiet < 20) and time.monotonic() < end:
        executor.spin_once(timeout_sec=0.05)
        quiet = quiet + 1 if counted.taken + len(seen) == before else 0
        before = counted.taken + len(seen)
    assert process.returncode == 0 and node.healthy
    stamps = [stamp for stamp, _ in seen]
    assert stamps == sorted(stamps) and len(seen) == node.statistics["refinement"].given
    # A set lacks only where all of its views came too late or were overtaken in a queue: a slow machine.
    told = counted.notices
    lost = [told["sync.late_frame"], told["sync.few_views"], counted.dropped["queue_full"]]
    missing = set(range(FRAMES)) - {round(stamp / period) for stamp in stamps}
    assert len(missing) <= sum(lost), (missing, told, counted.dropped)
    after = [people for stamp, people in seen if stamp > (DIES_AT + 25) * period]
    assert len(after) > 5 and sum(people == 2 for people in after) > 0.8 * len(after)
