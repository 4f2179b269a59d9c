"""A stage's node on the live graph: bad messages are counted and dropped, and the node lives."""

import time

import captures
import pytest
from spinning import spin_until

rclpy = pytest.importorskip("rclpy")
from rclpy.parameter import Parameter  # noqa: E402

from panoptic_ros.errors import ConfigError  # noqa: E402
from panoptic_ros.graph.flow import make_flow  # noqa: E402
from panoptic_ros.graph.nodes import NODES  # noqa: E402
from panoptic_ros.graph.topics import TOPICS  # noqa: E402
from panoptic_ros.io.messages import from_message, to_message  # noqa: E402
from panoptic_ros.io.skeletons import load_skeleton  # noqa: E402
from panoptic_ros.nodes.main import EXTRAS, make_stage_node  # noqa: E402
from panoptic_ros.nodes.middleware.family import message_class, ros_messages  # noqa: E402
from panoptic_ros.nodes.middleware.quality import LATCHED, data_quality  # noqa: E402
from panoptic_ros.nodes.sources.statics_node import StaticsNode  # noqa: E402
from panoptic_ros.nodes.stages.stage_node import StageNode  # noqa: E402

pytestmark = pytest.mark.ros
VIEW = message_class("panoptic_msgs/msg/ViewDetections")
SET = message_class("panoptic_msgs/msg/DetectionSet")


@pytest.fixture
def sync_node(executor):
    """A sync node in live flow, with a tester that publishes views and takes sets."""
    node = StageNode("sync", {"flow": "live", "window_s": 0.005, "deadline_s": 0.05})
    statics = StaticsNode(captures.RIG, captures.SKELETON)
    tester = rclpy.create_node("tester")
    quality = data_quality(make_flow("live"))
    publishers = {n: tester.create_publisher(VIEW, f"{n}/detections", quality) for n in captures.RIG.names}
    sets = []
    tester.create_subscription(SET, "detection_sets", sets.append, 10)
    for item in (node, statics, tester):
        executor.add_node(item)
    spin_until(
        executor,
        lambda: (
            all(p.get_subscription_count() for p in publishers.values())
            and tester.count_publishers("detection_sets")
        ),
    )
    for _ in range(10):
        executor.spin_once(timeout_sec=0.1)
    return node, executor, publishers, sets


def send(publishers, index):
    for camera in captures.RIG.cameras:
        view = captures.view(camera, index, round(index * 1e9 / 30))
        publishers[camera.name].publish(to_message(view, ros_messages()))


def break_scores(message):
    message.scores = message.scores[:-1]


def break_nan(message):
    message.points[0] = float("nan")


def break_size(message):
    message.image_width = 0


def break_skeleton(message):
    message.skeleton_hash = "00000000"


def break_camera(message):
    message.header.frame_id = captures.RIG.names[1]


def break_resolution(message):
    message.image_width //= 2


def break_joints(message):
    message.joint_count = 5
    message.points = message.points[: 2 * 5 * message.person_count]
    message.scores = message.scores[: 5 * message.person_count]


@pytest.mark.parametrize(
    "damage",
    [break_scores, break_nan, break_size, break_skeleton, break_camera, break_resolution, break_joints],
)
def test_bad_message_is_counted_and_dropped_and_the_node_lives(sync_node, damage):
    node, executor, publishers, sets = sync_node
    camera = captures.RIG.cameras[0]
    bad = to_message(captures.view(camera, 0, 1), ros_messages())
    damage(bad)
    publishers[camera.name].publish(bad)
    spin_until(executor, lambda: node.statistics["sync"].dropped["bad_message"] == 1)
    assert node.healthy
    for index in range(1, 6):
        send(publishers, index)
        for _ in range(6):
            executor.spin_once(timeout_sec=0.05)
    spin_until(executor, lambda: len(sets) >= 5)
    assert [len(from_message(item, "DetectionSet").views) for item in sets[:5]] == [4] * 5
    assert node.statistics["sync"].values()["dropped.bad_message"] == "1"


@pytest.mark.parametrize("key", ["rig", "skeleton_model"])
def test_facts_that_come_later_do_not_end_the_node(sync_node, key):
    """An empty one is bad; another one would need another stage. Both are told, and the node goes on."""
    node, executor, publishers, sets = sync_node
    topic = TOPICS[key]
    sender = rclpy.create_node("sender")
    publisher = sender.create_publisher(message_class(topic.message), topic.name, LATCHED)
    publisher.publish(message_class(topic.message)())
    spin_until(executor, lambda: node.statistics["sync"].dropped["bad_message"] == 1)
    other = captures.RIG.subset(captures.RIG.names[:2]) if key == "rig" else load_skeleton("coco17")
    publisher.publish(to_message(other, ros_messages()))
    for index in range(6):
        send(publishers, index)
        for _ in range(6):
            executor.spin_once(timeout_sec=0.05)
    spin_until(executor, lambda: len(sets) >= 4)
    assert node.healthy and node._facts.rig.names == captures.RIG.names
    assert f"another /{key} has" in trouble(node) and "restart node sync" in trouble(node)
    ours = {"rig": captures.RIG, "skeleton_model": captures.SKELETON}[key]
    publisher.publish(to_message(ours, ros_messages()))
    spin_until(executor, lambda: "another" not in trouble(node))
    sender.destroy_node()


def trouble(node):
    """What the node of sync says is wrong with it."""
    node._look()
    return next(s.trouble for s in node._health.statuses(time.monotonic_ns()) if s.name == "sync")


def test_missing_camera_is_waited_for_until_the_deadline_only(sync_node):
    _, executor, publishers, sets = sync_node
    for index in range(1, 8):
        for camera in captures.RIG.cameras[1:]:
            view = captures.view(camera, index, round(index * 1e9 / 30))
            publishers[camera.name].publish(to_message(view, ros_messages()))
        for _ in range(6):  # the cameras' messages may come in any order, but in this instant
            executor.spin_once(timeout_sec=0.05)
    spin_until(executor, lambda: len(sets) >= 3)
    counts = [len(from_message(item, "DetectionSet").views) for item in sets]
    assert max(counts) == 3


def test_parameters_are_declared_with_range_and_description(ros):
    node = StageNode("sync")
    descriptor = node.describe_parameter("window_s")
    assert "set" in descriptor.description and descriptor.floating_point_range[0].to_value == 1.0
    assert descriptor.read_only and descriptor.description.startswith("Expert: ")
    result = node.set_parameters([Parameter("window_s", value=0.1)])
    assert not result[0].successful
    node.close()
    node.destroy_node()


@pytest.mark.parametrize(
    ("parameters", "deadline"),
    [({"flow": "live"}, 0.5), ({"flow": "live", "deadline_s": 0.0}, 0.0), ({"flow": "replay"}, 0.0)],
)
def test_live_a_camera_that_fails_is_not_waited_for(ros, parameters, deadline):
    node = StageNode("sync", parameters)
    assert node.configs["sync"].deadline_s == deadline
    node.close()
    node.destroy_node()


def test_parameter_out_of_range_names_itself(ros):
    with pytest.raises(ConfigError, match="window_s"):
        StageNode("sync", {"window_s": 7.0})


def test_list_that_is_empty_by_default_can_be_set(ros):
    node = StageNode("detection", {"providers": ["CPUExecutionProvider"]})
    assert node.configs["detection"].providers == ("CPUExecutionProvider",)
    node.close()
    node.destroy_node()


@pytest.mark.parametrize("stage", sorted(NODES))
def test_every_stage_runs_as_a_node_of_its_own(executor, stage):
    """No parameter of a stage has the name of one of the node's."""
    node = StageNode(stage, {"flow": "replay"})
    executor.add_node(node)
    assert node.healthy and node.get_parameter("replay_window").value > 0


def test_what_another_stage_of_the_graph_gives_is_taken_of_every_camera(executor):
    values = {"flow": "live", "graph": ["appearance", "tracking"], "appearance": True}
    node, statics = StageNode("tracking", values), StaticsNode(captures.RIG, captures.SKELETON)
    for item in (node, statics):
        executor.add_node(item)

    def taken():
        return [node.count_subscribers(f"{name}/appearance") for name in captures.RIG.names]

    spin_until(executor, lambda: all(taken()))
    assert min(taken()) >= 1
    node.close()


def test_bodies_of_everybody_need_no_subject(executor):
    node = make_stage_node("kinematics", {"everybody": True, "flow": "live"})
    try:
        extras = EXTRAS["kinematics"](node, "", load_skeleton("panoptic19"))
        assert extras["subjects"] == () and extras["segments"].names[0] == "hips"
    finally:
        node.close()
        node.destroy_node()
