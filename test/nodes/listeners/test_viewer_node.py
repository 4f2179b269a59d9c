"""The viewer's node takes what somebody looks at, and previews are made while somebody does."""

import subprocess
import sys

import numpy as np
import pytest
from recorded_scene import SKELETON, START_NS, as_bytes, make_poses, make_preview, make_rig, make_view
from spinning import spin_until

rclpy = pytest.importorskip("rclpy")

from rclpy.parameter import Parameter  # noqa: E402

from panoptic_ros.domain import ViewFrame  # noqa: E402
from panoptic_ros.graph.flow import make_flow  # noqa: E402
from panoptic_ros.graph.topics import TOPICS  # noqa: E402
from panoptic_ros.io.messages import from_message, to_message  # noqa: E402
from panoptic_ros.nodes.health.reports import PreviewReports  # noqa: E402
from panoptic_ros.nodes.listeners.viewer_node import QUALITY, ViewerNode  # noqa: E402
from panoptic_ros.nodes.middleware.family import message_class, ros_messages  # noqa: E402
from panoptic_ros.nodes.middleware.quality import data_quality  # noqa: E402
from panoptic_ros.nodes.sources.statics_node import StaticsNode  # noqa: E402

pytestmark = pytest.mark.ros
RIG = make_rig(2)


class Taker:
    """Keeps what it is given."""

    def __init__(self, *keys):
        self.keys, self.facts, self.taken, self.told = frozenset(keys), [], [], []

    def begin(self, rig, skeleton):
        self.facts.append((rig.names, skeleton.name))

    def wanted(self):
        return self.keys

    def take(self, key, owner, data, now_s, wall_ns):
        self.taken.append((key, owner, data))

    def tell(self, name, status):
        self.told.append((name, status))


def publisher(node, key, owner=""):
    topic = TOPICS[key]
    return node.create_publisher(
        message_class(topic.message), topic.of(owner), data_quality(make_flow("live"))
    )


def test_only_what_is_wanted_is_subscribed_to_and_it_comes_as_it_is(executor):
    taker = Taker()
    node, statics, tester = ViewerNode(taker), StaticsNode(RIG, SKELETON), rclpy.create_node("tester")
    senders = {
        ("skeletons", ""): publisher(tester, "skeletons"),
        ("detections", "cam1"): publisher(tester, "detections", "cam1"),
        ("preview", "cam1"): publisher(tester, "preview", "cam1"),
    }
    for item in (node, statics, tester):
        executor.add_node(item)
    spin_until(executor, lambda: taker.facts == [(RIG.names, SKELETON.name)])
    assert not any(sender.get_subscription_count() for sender in senders.values())
    taker.keys = frozenset(["skeletons", "detections", "preview"])
    spin_until(executor, lambda: all(sender.get_subscription_count() for sender in senders.values()))
    poses = make_poses(RIG, 50, START_NS)
    records = {
        ("skeletons", ""): poses,
        ("detections", "cam1"): make_view(RIG.cameras[1], poses, START_NS),
        ("preview", "cam1"): make_preview("cam1", START_NS),
    }
    for topic, record in records.items():
        senders[topic].publish(to_message(record, ros_messages()))
    spin_until(executor, lambda: len(taker.taken) == 3)
    for key, owner, data in taker.taken:
        expected = as_bytes(records[key, owner])
        assert bytes(data)[: len(expected)] == expected
    taker.keys = frozenset()
    spin_until(executor, lambda: not any(sender.get_subscription_count() for sender in senders.values()))


def test_what_nodes_say_of_themselves_is_handed_on(executor):
    taker = Taker()
    node, tester = ViewerNode(taker), rclpy.create_node("tester")
    family = ros_messages()
    sender = tester.create_publisher(message_class("diagnostic_msgs/msg/DiagnosticArray"), "/diagnostics", 10)
    for item in (node, tester):
        executor.add_node(item)
    spin_until(executor, sender.get_subscription_count)
    status = family.make(
        "diagnostic_msgs/msg/DiagnosticStatus",
        level=b"\x01",
        name="panoptic: sync",
        message="3 dropped",
        hardware_id="cam1",
        values=[family.make("diagnostic_msgs/msg/KeyValue", key="taken", value="9")],
    )
    header = family.header(1, "")
    sender.publish(family.make("diagnostic_msgs/msg/DiagnosticArray", header=header, status=[status]))
    spin_until(executor, lambda: taker.told)
    name = "sync"
    said = {"name": name, "level": 1, "message": "3 dropped", "owner": "cam1", "values": {"taken": "9"}}
    assert taker.told[0] == (name, said)


def frames(count):
    image = np.zeros((48, 64, 3), np.uint8)
    return [ViewFrame("cam0", START_NS + round(k * 1e9 / 60), k, image) for k in range(count)]


@pytest.mark.parametrize("flow", ["live", "replay"])
def test_previews_are_published_while_somebody_looks_and_always_in_replay(executor, flow):
    overrides = [Parameter("flow", value=flow), Parameter("replay_window", value=64)]
    node = rclpy.create_node(
        "detection", parameter_overrides=overrides, automatically_declare_parameters_from_overrides=True
    )
    tester, got = rclpy.create_node("tester"), []
    for item in (node, tester):
        executor.add_node(item)
    reports = PreviewReports(node)
    for frame in frames(30):
        reports.take(frame)
    topic, quality = TOPICS["preview"], data_quality(make_flow(flow)) if flow == "replay" else QUALITY
    tester.create_subscription(message_class(topic.message), topic.of("cam0"), got.append, quality)
    early = [0, 6, 12, 18, 24] if flow == "replay" else []
    spin_until(executor, lambda: tester.count_publishers(topic.of("cam0")) and len(got) == len(early))
    spin_until(executor, lambda: reports._publisher("cam0").get_subscription_count())
    for frame in frames(60)[30:]:
        reports.take(frame)
    wanted = [*early, 30, 36, 42, 48, 54]
    spin_until(executor, lambda: len(got) == len(wanted) if flow == "replay" else got)
    stamps = [from_message(message, "Preview").stamp_ns for message in got]
    expected = [START_NS + round(k * 1e9 / 60) for k in wanted]
    assert stamps == expected if flow == "replay" else set(stamps) <= set(expected)


def test_what_the_viewer_loads_is_small():
    """No compiler, no scipy, no reader of bags, no generator of messages: they are half of its memory."""
    code = (
        "import panoptic_ros.running.viewer.live as live, sys\n"
        "live.start_ros([]); live.ViewerNode(live.LiveScene())\n"
        "print({'numba', 'scipy', 'rosbags', 'lark', 'cv2'} & set(sys.modules))"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "set()"
