"""The executor of the graph: messages with what the middleware knows of them, errors as they are."""

import pytest
from spinning import spin_until

rclpy = pytest.importorskip("rclpy")

from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.qos import QoSProfile  # noqa: E402
from rclpy.serialization import deserialize_message  # noqa: E402

from panoptic_ros.nodes.middleware.family import message_class  # noqa: E402
from panoptic_ros.nodes.middleware.runtime import make_executor, with_facts  # noqa: E402

pytestmark = pytest.mark.ros
TEXT = message_class("std_msgs/msg/Header")


@pytest.fixture(params=[make_executor, SingleThreadedExecutor])
def spinning(request, ros):
    node, executor = rclpy.create_node("taker"), request.param()
    executor.add_node(node)
    yield node, executor
    executor.shutdown()
    node.destroy_node()


def send(node, executor, names):
    publisher = node.create_publisher(TEXT, "header", QoSProfile(depth=10))
    spin_until(executor, publisher.get_subscription_count)
    for name in names:
        publisher.publish(TEXT(frame_id=name))


def test_a_message_comes_as_bytes_with_its_number(spinning):
    node, executor = spinning
    came = []

    def take(data, facts):
        came.append((deserialize_message(data, TEXT).frame_id, facts["publication_sequence_number"]))

    node.create_subscription(TEXT, "header", with_facts(take), QoSProfile(depth=10), raw=True)
    send(node, executor, "abc")
    spin_until(executor, lambda: len(came) == 3)
    first = came[0][1]
    assert came == [("a", first), ("b", first + 1), ("c", first + 2)]


def test_an_error_in_a_callback_reaches_who_spins(spinning):
    node, executor = spinning

    def take(data, facts):
        raise ArithmeticError("of the callback")

    node.create_subscription(TEXT, "header", with_facts(take), QoSProfile(depth=10), raw=True)
    send(node, executor, "a")
    with pytest.raises(ArithmeticError, match="of the callback"):
        spin_until(executor, lambda: False, 10.0)


def test_timers_and_what_is_made_and_destroyed_while_it_spins(spinning):
    node, executor = spinning
    ticks, came = [], []
    timer = node.create_timer(0.01, lambda: ticks.append(1))
    spin_until(executor, lambda: len(ticks) >= 3)
    node.destroy_timer(timer)
    subscription = node.create_subscription(TEXT, "header", came.append, QoSProfile(depth=10), raw=True)
    send(node, executor, "a")
    spin_until(executor, lambda: came)
    node.destroy_subscription(subscription)
    count = len(ticks)
    for _ in range(5):
        executor.spin_once(timeout_sec=0.02)
    assert len(ticks) <= count + 1
