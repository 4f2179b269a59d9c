"""Topics of many devices: read at a time, in the order of stamps, whatever waits of each."""

import contextlib

import pytest
from spinning import spin_until

rclpy = pytest.importorskip("rclpy")
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.qos import QoSProfile, ReliabilityPolicy  # noqa: E402
from rclpy.serialization import serialize_message  # noqa: E402

from panoptic_ros.nodes.middleware.family import message_class, ros_messages  # noqa: E402
from panoptic_ros.nodes.middleware.negotiation import NegotiatedSubscription  # noqa: E402
from panoptic_ros.nodes.middleware.packets import header_of  # noqa: E402
from panoptic_ros.nodes.middleware.read_together import GatheringNode, ReceivedMessage, SubscriptionPoller  # noqa: E402
from panoptic_ros.nodes.middleware.runtime import make_executor  # noqa: E402

pytestmark = pytest.mark.ros
HEADER = message_class("std_msgs/msg/Header")
DEEP = QoSProfile(depth=50)
BEST_EFFORT = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)


class Gathered:
    """A node that reads two devices, and what came."""

    def __init__(self):
        self.node, self.came, self.told, self.rounds = GatheringNode("taker"), [], [], 0
        self.node.together = SubscriptionPoller(self.node, self.at_once)
        self.sources = {name: self.source(name) for name in ("left", "right")}

    @contextlib.contextmanager
    def at_once(self):
        self.rounds += 1
        yield

    def source(self, name):
        def take(data, number):
            self.came.append((header_of(data)[0], name))

        return NegotiatedSubscription(
            self.node, HEADER, name, take, DEEP, True, self.told.append, self.node.together
        )

    def publishers(self, executor, quality=DEEP):
        found = {name: self.node.create_publisher(HEADER, name, quality) for name in self.sources}
        spin_until(executor, lambda: all(p.get_subscription_count() for p in found.values()))
        return found


@pytest.fixture(params=[make_executor, SingleThreadedExecutor])
def gathered(request, ros):
    executor, taker = request.param(), Gathered()
    executor.add_node(taker.node)
    yield taker, executor
    executor.shutdown()
    taker.node.destroy_node()


def message(stamp):
    return ros_messages().header(stamp, "device")


def test_what_waits_of_all_is_taken_in_the_order_of_stamps(gathered):
    taker, executor = gathered
    publishers = taker.publishers(executor)
    for name, stamps in (("left", range(0, 60, 3)), ("right", range(1, 60, 2))):  # one after the other
        for stamp in stamps:
            publishers[name].publish(message(stamp))
    taker.node.together.read()
    spin_until(executor, lambda: len(taker.came) == 50)
    assert taker.came == sorted(taker.came, key=lambda row: row[0])
    assert taker.rounds <= 3


def test_nobody_looks_while_nothing_can_come():
    class Steady:
        """Gives a message at every fifth look, as a device of 50 Hz does."""

        looks = 0

        def waiting(self):
            self.looks += 1
            return [ReceivedMessage(data, 0)] if number % 5 == 0 else []

        def take(self, came):
            taken.append(number)

    source, taken = Steady(), []
    together = SubscriptionPoller(Clockless(), contextlib.nullcontext)
    together.add(source)
    for number in range(100):
        data = serialize_message(message(number * 4_000_000))
        together.read()
    assert taken == list(range(0, 100, 5)) and source.looks <= 3 * len(taken) + 2


class Clockless:
    """A node whose timer never comes."""

    def create_timer(self, period, callback, clock):
        return None


def test_a_driver_with_best_effort_is_heard(gathered):
    taker, executor = gathered
    publishers = taker.publishers_of = {
        n: taker.node.create_publisher(HEADER, n, BEST_EFFORT) for n in taker.sources
    }

    def heard():
        for publisher in publishers.values():
            publisher.publish(message(1))
        return {name for _, name in taker.came} == {"left", "right"}

    spin_until(executor, heard)
    assert [notice.code for notice in taker.told] == 2 * ["graph.best_effort"]
    assert not any(source.is_reliable for source in taker.sources.values())


def test_one_that_pauses_leaves_the_others_alone(gathered):
    taker, executor = gathered
    publishers, back = taker.publishers(executor), []
    taker.sources["left"].pause(0.3, lambda: back.append(1))

    def heard():
        publishers["right"].publish(message(2))
        return len(taker.came) > 5

    spin_until(executor, heard)
    assert {name for _, name in taker.came} == {"right"}
    spin_until(executor, lambda: bool(back))

    def heard_again():
        publishers["left"].publish(message(3))
        return (3, "left") in taker.came

    spin_until(executor, heard_again)


def test_executors_are_told_of_all_other_subscriptions(gathered):
    taker, executor = gathered
    came = []
    other = taker.node.create_subscription(HEADER, "other", came.append, DEEP)
    assert other in set(taker.node.subscriptions)
    publisher = taker.node.create_publisher(HEADER, "other", DEEP)
    spin_until(executor, publisher.get_subscription_count)
    publisher.publish(message(4))
    spin_until(executor, lambda: bool(came))
