"""The launcher's node knows when it has everything."""
import time

import captures
import pytest
from spinning import spin_until

rclpy = pytest.importorskip("rclpy")

from rclpy.qos import qos_profile_sensor_data  # noqa: E402

from panoptic_ros.domain import ImuSample  # noqa: E402
from panoptic_ros.graph.flow import make_flow  # noqa: E402
from panoptic_ros.io.messages import to_message  # noqa: E402
from panoptic_ros.nodes.listeners.collector_node import CollectorNode  # noqa: E402
from panoptic_ros.nodes.middleware.family import message_class, ros_messages  # noqa: E402
from panoptic_ros.nodes.middleware.quality import END_OF_STREAM, data_quality  # noqa: E402

pytestmark = pytest.mark.ros


def test_waits_for_detections_that_come_after_the_last_skeletons(executor):
    flow, camera, taken = make_flow("replay"), captures.RIG.cameras[0], []
    collector = CollectorNode(flow, [camera.name], lambda key, record: taken.append(key))
    sender = rclpy.create_node("sender")
    kind = message_class("panoptic_msgs/msg/EndOfStream")
    ends = sender.create_publisher(kind, "end_of_stream", END_OF_STREAM)
    views = sender.create_publisher(
        message_class("panoptic_msgs/msg/ViewDetections"), f"{camera.name}/detections", data_quality(flow)
    )
    for node in (collector, sender):
        executor.add_node(node)

    def spin(seconds, ready=lambda: False):
        until = time.monotonic() + seconds
        while not ready() and time.monotonic() < until:
            executor.spin_once(timeout_sec=0.05)

    ends.publish(kind(topic="/skeletons", count=0))
    ends.publish(kind(topic=f"/{camera.name}/detections", count=2))
    spin(1.5)
    assert not collector.over
    bad, good = (to_message(captures.view(camera, k, 0), ros_messages()) for k in range(2))
    bad.person_count = 77
    views.publish(bad)
    views.publish(good)
    spin(15.0, lambda: collector.over)
    assert collector.over and taken == ["detections"]
    assert collector.diagnostics["collector"] == {"dropped.bad_message": "1"}


def test_samples_of_drivers_that_offer_best_effort_are_taken_live_by_the_name_of_their_topic(executor):
    taken = []
    collector = CollectorNode(
        make_flow("live"), (), lambda key, record: taken.append((key, record)), bodies=["back"]
    )
    driver = rclpy.create_node("driver")
    kind = message_class("sensor_msgs/msg/Imu")
    publisher = driver.create_publisher(kind, "back/imu", qos_profile_sensor_data)
    for node in (collector, driver):
        executor.add_node(node)
    message = to_message(ImuSample("imu_link", 5, [1, 0, 0, 0], [0, 0, 0], [0, 0, 9.8]), ros_messages())

    def came():
        publisher.publish(message)
        return any(key == "imu" for key, _ in taken)

    spin_until(executor, came)
    assert next(record.device for key, record in taken if key == "imu") == "back"
