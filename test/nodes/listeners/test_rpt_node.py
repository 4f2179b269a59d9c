"""2D people of another stack reach the graph."""

import captures
import pytest
from spinning import spin_until

rclpy = pytest.importorskip("rclpy")
rpt_msgs = pytest.importorskip("rpt_msgs.msg", reason="./run messages rpt_msgs builds them")

from panoptic_ros.nodes.listeners.rpt_node import RptNode  # noqa: E402
from panoptic_ros.nodes.middleware.family import message_class, ros_messages  # noqa: E402
from panoptic_ros.nodes.sources.statics_node import StaticsNode  # noqa: E402

pytestmark = pytest.mark.ros


def test_poses_become_detections(executor):
    node, other = RptNode({"topics": ["cam0=/poses/cam0"]}), rclpy.create_node("other")
    for each in (node, other, StaticsNode(captures.RIG, captures.SKELETON)):
        executor.add_node(each)
    seen = []
    kind = message_class("panoptic_msgs/msg/ViewDetections")
    other.create_subscription(kind, "cam0/detections", seen.append, 10)
    publisher = other.create_publisher(rpt_msgs.Poses, "/poses/cam0", 10)
    message = rpt_msgs.Poses(
        header=ros_messages().header(5, "c"),
        bodies_flat=[10.0, 20.0, 0.9, 30.0, 40.0, 0.9],
        bodies_shape=[1, 2, 3],
        joint_names=["shoulder_left", "shoulder_right"],
    )

    def done():
        publisher.publish(message)
        return bool(seen)

    spin_until(executor, done)
    assert seen[0].person_count == 1 and seen[0].header.frame_id == "cam0" and node.healthy
