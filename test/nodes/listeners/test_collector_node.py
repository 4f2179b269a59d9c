"""The launcher's node knows when it has everything."""

import time
from functools import partial

import captures
import numpy as np
import pytest
from recordings import write_bag
from spinning import spin_until

rclpy = pytest.importorskip("rclpy")

from rclpy.qos import qos_profile_sensor_data  # noqa: E402

from panoptic_ros.domain import ImuSample, JointState, RefinedPoseSet  # noqa: E402
from panoptic_ros.graph.flow import make_flow  # noqa: E402
from panoptic_ros.io.messages import to_message  # noqa: E402
from panoptic_ros.io.skeletons import load_skeleton  # noqa: E402
from panoptic_ros.nodes.listeners.collector_node import CollectorNode, _is_usable  # noqa: E402
from panoptic_ros.nodes.middleware.family import message_class, ros_messages  # noqa: E402
from panoptic_ros.nodes.middleware.quality import END_OF_STREAM, data_quality  # noqa: E402
from panoptic_ros.running.plans.bag_plan import plan_bags  # noqa: E402
from panoptic_ros.running.runs.results import check_record  # noqa: E402

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


def test_messages_that_are_not_of_the_run_are_counted_and_dropped(executor, tmp_path):
    """Detections of another camera, skeletons of another kind, and /diagnostics with other fields."""
    bag = write_bag(tmp_path / "bag", captures.views(2))
    plan, taken = plan_bags([bag]), []
    collector = CollectorNode(
        make_flow("live"), ["cam0"], lambda key, record: taken.append(key), check=partial(check_record, plan)
    )
    sender = rclpy.create_node("sender")
    live = data_quality(make_flow("live"))
    views = sender.create_publisher(
        message_class("panoptic_msgs/msg/ViewDetections"), "cam0/detections", live
    )
    people = sender.create_publisher(message_class("panoptic_msgs/msg/Skeletons"), "skeletons", live)
    status = message_class("diagnostic_msgs/msg/DiagnosticArray")
    health = sender.create_publisher(status, "/diagnostics", 10)
    for node in (collector, sender):
        executor.add_node(node)
    odd = ros_messages().make(
        "diagnostic_msgs/msg/DiagnosticStatus",
        level=b"\x00",
        name="panoptic: sync",
        message="",
        hardware_id="",
        values=[ros_messages().make("diagnostic_msgs/msg/KeyValue", key="taken", value="x")],
    )
    shape = (1, 17)
    few = RefinedPoseSet(
        0,
        5,
        load_skeleton("coco17").hash,
        np.zeros((*shape, 3)),
        np.tile(np.eye(3), (*shape, 1, 1)),
        np.ones(shape),
        np.full(shape, 4),
        np.full(shape, JointState.MEASURED),
        np.ones(1),
        ids=np.array([1]),
    )
    dropped = {}

    def came():
        views.publish(to_message(captures.view(captures.RIG.cameras[1], 0, 5), ros_messages()))
        people.publish(to_message(few, ros_messages()))
        health.publish(
            ros_messages().make(
                "diagnostic_msgs/msg/DiagnosticArray",
                header=ros_messages().header(0, ""),
                status=[odd],
            )
        )
        dropped.update(collector.diagnostics.get("collector", {}))
        return len(collector._refused) == 3

    spin_until(executor, came)
    assert taken == [key for key in taken if key == "diagnostics"] and "sync" not in collector.diagnostics
    assert int(dropped["dropped.bad_message"]) >= 2
    views.publish(to_message(captures.view(captures.RIG.cameras[0], 0, 5), ros_messages()))
    spin_until(executor, lambda: "detections" in taken)


def test_numbers_on_diagnostics_are_of_the_kind_that_reports_read():
    good = {"taken": "7", "dropped.lost": "0", "notice.sync.late_frame": "3", "step_p50_ms": "nan", "x": "y"}
    bad = {"taken": "", "dropped.lost": "1.5", "notice.sync.late_frame": "nan", "step_p99_ms": "slow"}
    assert all(_is_usable(key, value) for key, value in good.items())
    assert not any(_is_usable(key, value) for key, value in bad.items())
