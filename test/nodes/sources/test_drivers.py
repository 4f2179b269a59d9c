"""Topics of drivers on the live graph: what they offer is taken, and what does not fit is told."""

import threading

import captures
import numpy as np
import pytest
from spinning import spin_until

rclpy = pytest.importorskip("rclpy")
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy  # noqa: E402
from rclpy.serialization import deserialize_message  # noqa: E402

from panoptic_ros.domain import ViewFrame  # noqa: E402
from panoptic_ros.errors import EnvironmentProblem  # noqa: E402
from panoptic_ros.graph.arrivals import ArrivalCounters  # noqa: E402
from panoptic_ros.io.messages import camera_info_message, image_message  # noqa: E402
from panoptic_ros.nodes.middleware.family import message_class, ros_messages  # noqa: E402
from panoptic_ros.nodes.middleware.negotiation import NegotiatedSubscription  # noqa: E402
from panoptic_ros.nodes.sources.drivers import CAMERA_INFO, find_drivers  # noqa: E402
from panoptic_ros.nodes.stages.inputs import lossy  # noqa: E402

pytestmark = pytest.mark.ros
IMAGE = message_class("sensor_msgs/msg/Image")
BEST_EFFORT = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def picture():
    return image_message(ViewFrame("cam0", 5, 0, np.zeros((12, 16, 3), np.uint8)), ros_messages())


def taker(node, quality, gives_way=True):
    taken, told = [], []

    def take(data, number):
        taken.append(deserialize_message(data, IMAGE))

    subscription = NegotiatedSubscription(
        node, IMAGE, "/driver/image_raw", take, quality, gives_way, told.append
    )
    return subscription, taken, told


def exchange(executor, quality, asked, gives_way=True, enough=lambda taken, told: bool(taken)):
    """What a driver that offers this quality gets through."""
    driver, ours = rclpy.create_node("driver"), rclpy.create_node("ours")
    executor.add_node(driver)
    executor.add_node(ours)
    subscription, taken, told = taker(ours, asked, gives_way)
    publisher = driver.create_publisher(IMAGE, "/driver/image_raw", quality)

    def done():
        publisher.publish(picture())
        return enough(taken, told)

    spin_until(executor, done)
    return subscription, taken, told


@pytest.mark.parametrize("offered", [BEST_EFFORT, QoSProfile(depth=1), LATCHED])
def test_images_of_any_driver_arrive(executor, offered):
    subscription, taken, told = exchange(executor, offered, QoSProfile(depth=2))
    assert taken[0].width == 16
    best_effort = offered.reliability == ReliabilityPolicy.BEST_EFFORT
    assert subscription.is_reliable != best_effort
    assert [n.code for n in told] == (["graph.best_effort"] if best_effort else [])


def test_what_cannot_give_way_is_told(executor):
    _, taken, told = exchange(executor, QoSProfile(depth=1), LATCHED, enough=lambda taken, told: bool(told))
    assert not taken and told[0].severity == "warning" and told[0].code == "graph.incompatible_qos"
    assert "/driver/image_raw" in told[0].text and "durability" in told[0].text


def test_types_and_camera_info_are_found(executor):
    driver = rclpy.create_node("driver")
    executor.add_node(driver)
    images = driver.create_publisher(IMAGE, "/driver/image_raw", BEST_EFFORT)
    infos = driver.create_publisher(message_class(CAMERA_INFO), "/driver/camera_info", BEST_EFFORT)
    timer = driver.create_timer(
        0.05, lambda: infos.publish(camera_info_message(captures.RIG.cameras[0], 3, ros_messages()))
    )
    stop = threading.Event()
    thread = threading.Thread(target=lambda: [executor.spin_once(0.05) for _ in iter(stop.is_set, True)])
    thread.start()
    try:
        wanted = {"/driver/image_raw": "image of camera left", "/driver/camera_info": "camera_info of left"}
        found = find_drivers(wanted, 20.0)
        told = "no node publishes /driver/image .*there are /driver/image_raw"
        with pytest.raises(EnvironmentProblem, match=told):
            find_drivers({"/driver/image": "image of camera left"}, 1.5)
    finally:
        stop.set()
        thread.join()
    assert found.types == {"/driver/image_raw": "sensor_msgs/msg/Image", "/driver/camera_info": CAMERA_INFO}
    assert found.infos["/driver/camera_info"].width == captures.RIG.cameras[0].image_size[0]
    assert images and timer


def test_a_driver_that_loses_images_shall_have_the_profile_of_the_graph(monkeypatch):
    arrivals = ArrivalCounters("image", "left", "/driver/image", True, 0)
    for k in range(10):
        arrivals.came(k * 10**8, 1 + 4 * k)
    monkeypatch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", "/tmp/ours.xml")
    notice = lossy(arrivals, 6_300_000)
    assert "73 % of /driver/image (6.3 MB each)" in notice.text and "FILE=/tmp/ours.xml," in notice.text
    monkeypatch.delenv("FASTRTPS_DEFAULT_PROFILES_FILE")
    assert "config/fastdds.xml," in lossy(arrivals, 6_300_000).text
