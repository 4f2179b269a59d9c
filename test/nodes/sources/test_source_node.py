"""Samples of IMUs alone wait for their readers, and for bodies."""

import pytest
from spinning import spin_until

rclpy = pytest.importorskip("rclpy")

from panoptic_ros.domain import ImuSample  # noqa: E402
from panoptic_ros.graph.flow import SPARE, make_flow  # noqa: E402
from panoptic_ros.graph.topics import TOPICS  # noqa: E402
from panoptic_ros.nodes.middleware.family import message_class  # noqa: E402
from panoptic_ros.nodes.middleware.quality import collecting_quality, data_quality  # noqa: E402
from panoptic_ros.nodes.sources.making import SourceNode, imu_messages  # noqa: E402

pytestmark = pytest.mark.ros
COUNT, WINDOW = 40, 16
PERIOD_NS = 10_000_000


def samples():
    for k in range(COUNT):
        yield ImuSample("wrist", PERIOD_NS * (k + 1), (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 9.8))


def test_imus_alone_wait_for_readers_and_for_bodies(executor):
    flow, came = make_flow("replay", WINDOW), []
    topic, bodies = TOPICS["imu"], TOPICS["bodies"]
    values = {"flow": "replay", "replay_window": WINDOW, "readers": 2}
    source = SourceNode("imus", {"wrist": (topic.of("wrist"), topic.message)}, values, sound_beside=())
    source.start(imu_messages(samples()))
    reader = rclpy.create_node("reader")
    for node in (source, reader):
        executor.add_node(node)

    def read(take, of, name):
        reader.create_subscription(message_class(of.message), name, take, collecting_quality(flow))

    read(came.append, topic, topic.of("wrist"))
    given = reader.create_publisher(message_class(bodies.message), bodies.name, data_quality(flow))
    for _ in range(10):
        executor.spin_once(timeout_sec=0.05)
    assert not came  # one reader is missing
    read(lambda message: None, topic, topic.of("wrist"))
    read(lambda message: None, bodies, bodies.name)
    spin_until(executor, lambda: len(came) >= WINDOW)
    for _ in range(10):
        executor.spin_once(timeout_sec=0.05)
    assert len(came) == WINDOW < WINDOW + SPARE < COUNT  # no body has come out
    for sent in range(1, COUNT + 1):
        wanted = range(min(WINDOW + sent, COUNT))
        message = message_class(bodies.message)()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(PERIOD_NS * sent, 10**9)
        given.publish(message)
        spin_until(executor, lambda wanted=wanted: len(came) >= len(wanted))
    stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in came]
    assert stamps == [PERIOD_NS * (k + 1) for k in range(COUNT)]
