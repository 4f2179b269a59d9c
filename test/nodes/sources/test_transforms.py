"""Poses of frames from publishers of /tf and /tf_static, as native drivers have them."""

import threading

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy")
tf2_msgs = pytest.importorskip("tf2_msgs.msg", reason="./run messages tf2_msgs builds them")
from rclpy.qos import DurabilityPolicy, QoSProfile  # noqa: E402

from panoptic_ros.errors import CalibrationError, EnvironmentProblem  # noqa: E402
from panoptic_ros.geometry import Rigid  # noqa: E402
from panoptic_ros.io.messages.transforms import transform_message  # noqa: E402
from panoptic_ros.nodes.middleware.family import ros_messages  # noqa: E402
from panoptic_ros.nodes.sources.transforms import find_transforms  # noqa: E402

pytestmark = pytest.mark.ros


def moved(x):
    return Rigid(np.eye(3), [x, 0.0, 0.0])


@pytest.fixture
def broadcasting(executor):
    """Publishes transforms: static ones once, latched, and others all the time."""
    node = rclpy.create_node("broadcaster")
    executor.add_node(node)
    stop, threads = threading.Event(), []

    def begin(static, moving):
        def message(rows):
            return tf2_msgs.TFMessage(
                transforms=[transform_message(ros_messages(), 1, *row[:2], moved(row[2])) for row in rows]
            )

        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        node.create_publisher(tf2_msgs.TFMessage, "/tf_static", latched).publish(message(static))
        publisher = node.create_publisher(tf2_msgs.TFMessage, "/tf", 10)
        node.create_timer(0.05, lambda: publisher.publish(message(moving)))

        def spin():
            while not stop.is_set():
                executor.spin_once(timeout_sec=0.05)

        threads.append(threading.Thread(target=spin))
        threads[0].start()

    yield begin
    stop.set()
    for thread in threads:
        thread.join()


def test_static_and_moving_transforms_hang_together(broadcasting):
    broadcasting([("base", "left_optical", 1.0), ("base", "right_optical", -1.0)], [("map", "base", 10.0)])
    world, poses = find_transforms(["left_optical", "right_optical"], patience_s=20.0)
    assert world == "map"
    assert poses["left_optical"].translation[0] == 11.0 and poses["right_optical"].translation[0] == 9.0
    world, poses = find_transforms(["left_optical"], "right_optical", 20.0)
    assert world == "right_optical" and poses["left_optical"].translation[0] == 2.0


def test_what_is_missing_is_named_with_the_remedy(broadcasting):
    broadcasting([("base", "left_optical", 1.0), ("odom", "right_optical", 1.0)], [])
    with pytest.raises(CalibrationError, match=r"no frame 'lft_optical'; it has left_optical, .*static_"):
        find_transforms(["lft_optical"], patience_s=2.5)
    with pytest.raises(
        CalibrationError, match=r"does not connect 'right_optical' .* publish a transform that connects"
    ):
        find_transforms(["left_optical", "right_optical"], patience_s=2.5)


def test_nobody_who_tells(executor):
    with pytest.raises(EnvironmentProblem, match=r"no message on /tf or /tf_static within 0.3 s.*--rig"):
        find_transforms(["left_optical"], patience_s=0.3)
