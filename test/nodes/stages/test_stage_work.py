"""A live node pauses and goes on with the people that it knew."""

import re
import time

import captures
import pytest
from spinning import spin_until, spin_until_quiet

rclpy = pytest.importorskip("rclpy")

from panoptic_ros.graph.nodes import AFTER_DETECTION  # noqa: E402
from panoptic_ros.graph.topics import TOPICS  # noqa: E402
from panoptic_ros.io.messages import to_message  # noqa: E402
from panoptic_ros.nodes.middleware.family import message_class, ros_messages, service_class  # noqa: E402
from panoptic_ros.nodes.sources.statics_node import StaticsNode  # noqa: E402
from panoptic_ros.nodes.stages.stage_node import StageNode  # noqa: E402

pytestmark = pytest.mark.ros
SET = service_class("std_srvs/srv/SetBool")


class Feed:
    """Views of all cameras, an instant every time."""

    def __init__(self, executor):
        self.executor, self.node = executor, rclpy.create_node("feed")
        executor.add_node(self.node)
        kind = message_class("panoptic_msgs/msg/ViewDetections")
        self.publishers = {
            name: self.node.create_publisher(kind, TOPICS["detections"].of(name), 10)
            for name in captures.RIG.names
        }
        self.client = self.node.create_client(SET, "/fusion/pause")
        self.index, self.seen = 0, []
        skeletons = message_class("panoptic_msgs/msg/Skeletons")
        self.node.create_subscription(skeletons, "skeletons", self.seen.append, 100)

    def play(self, ready):
        def step():
            time.sleep(0.01)  # no faster than the node works: two seconds left out are an absence
            self.index += 1
            for camera in captures.RIG.cameras:
                view = captures.view(camera, self.index, round(self.index * 1e9 / 30))
                self.publishers[camera.name].publish(to_message(view, ros_messages()))
            return ready()

        spin_until(self.executor, step, 60.0)

    def ask(self, paused):
        future = self.client.call_async(SET.Request(data=paused))
        spin_until(self.executor, future.done)
        return future.result()


def test_paused_and_resumed(executor):
    node = StageNode(AFTER_DETECTION, {"flow": "live"}, name="fusion")
    executor.add_node(node)
    executor.add_node(StaticsNode(captures.RIG, captures.SKELETON))
    feed = Feed(executor)
    feed.play(lambda: len(feed.seen) > 5 and len(feed.seen[-1].skeletons) == 2)
    ids = {person.id for person in feed.seen[-1].skeletons}

    assert feed.ask(True).message == "paused" and not feed.ask(True).success
    spin_until_quiet(executor, feed.seen)  # sets that it had taken before are still worked on
    count, begin = len(feed.seen), feed.index
    feed.play(lambda: feed.index - begin >= 15)
    spin_until_quiet(executor, feed.seen)
    assert len(feed.seen) == count

    answer = feed.ask(False)
    assert answer.success and int(re.search(r"\d+", answer.message)[0]) >= 10
    feed.play(lambda: len(feed.seen) > count + 5)
    assert {person.id for person in feed.seen[-1].skeletons} == ids
    assert feed.ask(False).message == "was not paused" and node.healthy
