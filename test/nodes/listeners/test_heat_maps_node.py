"""Heat maps come while somebody looks, and cost nothing otherwise."""

import captures
import pytest
from spinning import spin_until

rclpy = pytest.importorskip("rclpy")

from panoptic_ros.io.messages import to_message  # noqa: E402
from panoptic_ros.nodes.listeners.heat_maps_node import HeatMapsNode  # noqa: E402
from panoptic_ros.nodes.middleware.family import message_class, ros_messages  # noqa: E402
from panoptic_ros.nodes.sources.statics_node import StaticsNode  # noqa: E402

pytestmark = pytest.mark.ros


def test_only_who_is_looked_at_is_read(executor):
    node, other = HeatMapsNode(), rclpy.create_node("other")
    for each in (node, other, StaticsNode(captures.RIG, captures.SKELETON)):
        executor.add_node(each)
    kind = message_class("panoptic_msgs/msg/ViewDetections")
    publishers = {name: other.create_publisher(kind, f"{name}/detections", 10) for name in captures.RIG.names}
    seen = []
    looking = other.create_subscription(
        message_class("sensor_msgs/msg/Image"), "cam1/heat_map", seen.append, 10
    )

    def sent(ready):
        for camera in captures.RIG.cameras:
            publishers[camera.name].publish(to_message(captures.view(camera, 1, 5), ros_messages()))
        return ready()

    spin_until(executor, lambda: sent(lambda: bool(seen)))
    assert node.cameras == ("cam1",) and seen[0].encoding == "mono8"
    other.destroy_subscription(looking)
    spin_until(executor, lambda: not node.cameras)
