"""Markers follow /skeletons, and skeletons of another model are dropped."""

import time

import captures
import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy")

from panoptic_ros.domain import RefinedPoseSet  # noqa: E402
from panoptic_ros.graph.flow import make_flow  # noqa: E402
from panoptic_ros.io.messages import to_message  # noqa: E402
from panoptic_ros.nodes.listeners.people_node import MarkersNode  # noqa: E402
from panoptic_ros.nodes.middleware.family import message_class, ros_messages  # noqa: E402
from panoptic_ros.nodes.middleware.quality import data_quality  # noqa: E402
from panoptic_ros.nodes.sources.statics_node import StaticsNode  # noqa: E402

pytestmark = pytest.mark.ros


def skeletons(joints, skeleton_hash):
    people = 2
    record = RefinedPoseSet(
        0,
        1,
        skeleton_hash,
        np.zeros((people, joints, 3)),
        np.tile(np.eye(3), (people, joints, 1, 1)),
        np.ones((people, joints)),
        np.full((people, joints), 3),
        np.ones((people, joints)),
        np.ones(people),
        ids=[3, 4],
    )
    return to_message(record, ros_messages())


def test_skeletons_of_another_model_are_dropped_and_the_node_lives(executor):
    node, statics = MarkersNode("replay"), StaticsNode(captures.RIG, captures.SKELETON)
    tester, got = rclpy.create_node("tester"), []
    sender = tester.create_publisher(
        message_class("panoptic_msgs/msg/Skeletons"), "skeletons", data_quality(make_flow("replay"))
    )
    tester.create_subscription(
        message_class("visualization_msgs/msg/MarkerArray"), "skeletons/markers", got.append, 10
    )
    for item in (node, statics, tester):
        executor.add_node(item)

    def spin_until(ready):
        end = time.monotonic() + 15.0
        while not ready() and time.monotonic() < end:
            executor.spin_once(timeout_sec=0.05)
        assert ready()

    spin_until(lambda: node._reader._skeleton is not None and node._publisher.get_subscription_count())
    sender.publish(skeletons(3, "cafe0123"))
    sender.publish(skeletons(len(captures.SKELETON), captures.SKELETON.hash))
    spin_until(lambda: got)
    assert len(got) == 1 and len(got[0].markers) == 6
    counted = node._reader.statistics
    assert (counted.taken, counted.dropped["bad_message"]) == (1, 1)
