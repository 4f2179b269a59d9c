"""/skeletons in other words, by real subscribers."""
import captures
import numpy as np
import pytest
from spinning import spin_until

rclpy = pytest.importorskip("rclpy")

from panoptic_ros.cli.run.usage import PUBLISHABLE  # noqa: E402
from panoptic_ros.domain import JointState, RefinedPoseSet  # noqa: E402
from panoptic_ros.errors import ConfigError  # noqa: E402
from panoptic_ros.io.messages import to_message  # noqa: E402
from panoptic_ros.nodes.family import message_class, ros_messages  # noqa: E402
from panoptic_ros.nodes.people_node import KINDS, PeopleNode  # noqa: E402
from panoptic_ros.nodes.quality import LATCHED  # noqa: E402

pytestmark = pytest.mark.ros


def people():
    positions = captures.people(0.2)
    shape = positions.shape[:2]
    return RefinedPoseSet(
        0, 5, captures.SKELETON.hash, positions, np.broadcast_to(np.eye(3), (*shape, 3, 3)), np.ones(shape),
        np.full(shape, 4), np.full(shape, JointState.MEASURED), np.ones(2), ids=np.array([1, 12]),
    )  # fmt: skip


def heard(executor, node, topic, kind):
    """The first message of the node on a topic."""
    other = rclpy.create_node("other")
    executor.add_node(node)
    executor.add_node(other)
    seen = []
    other.create_subscription(message_class(kind), topic, seen.append, 10)
    kind = message_class("panoptic_msgs/msg/SkeletonModel")
    model = other.create_publisher(kind, "skeleton_model", LATCHED)
    model.publish(to_message(captures.SKELETON, ros_messages()))
    skeletons = other.create_publisher(message_class("panoptic_msgs/msg/Skeletons"), "skeletons", 10)
    message = to_message(people(), ros_messages(), "hall")

    def done():
        skeletons.publish(message)
        return bool(seen)

    spin_until(executor, done)
    return seen[0]


def test_roots_are_published_on_demand(executor):
    message = heard(executor, PeopleNode(), "skeletons/roots", KINDS["roots"][1])
    assert len(message.poses) == 2 and message.header.frame_id == "hall"


def test_joints_are_in_tf_only_where_it_is_asked_for(executor):
    pytest.importorskip("tf2_msgs", reason="./run messages tf2_msgs builds them")
    node = PeopleNode(overrides={"publish": ["tf"], "tf_prefix": "lab/"})
    message = heard(executor, node, "/tf", KINDS["tf"][1])
    assert node.published == ("/tf",)
    children = {t.child_frame_id for t in message.transforms}
    assert {"lab/body_p1", "lab/p12_Nose"} <= children
    assert {t.header.frame_id for t in message.transforms} == {"hall"}


def test_bodies_are_listed_in_messages_of_rep_155(executor):
    pytest.importorskip("hri_msgs", reason="./run messages hri_msgs builds them")
    node = PeopleNode(overrides={"publish": ["bodies"]})
    message = heard(executor, node, "/humans/bodies/tracked", KINDS["bodies"][1])
    assert list(message.ids) == ["p1", "p12"] and message.header.frame_id == "hall"


def test_boxes_hold_all_joints_of_a_person(executor):
    pytest.importorskip("vision_msgs", reason="./run messages vision_msgs builds them")
    node = PeopleNode(overrides={"publish": ["boxes"]})
    message = heard(executor, node, "skeletons/boxes", KINDS["boxes"][1])
    assert [box.id for box in message.detections] == ["p1", "p12"]
    for box, joints in zip(message.detections, captures.people(0.2)):
        centre, size = box.bbox.center.position, box.bbox.size
        away = np.abs(joints - [centre.x, centre.y, centre.z])
        assert (away <= 0.5 * np.array([size.x, size.y, size.z])).all()
        assert box.results[0].hypothesis.class_id == "person"


def test_tf_is_off_by_default_and_what_is_not_installed_is_left_out(executor):
    node = PeopleNode()
    executor.add_node(node)
    assert "/tf" not in node.published and "/skeletons/roots" in node.published


def test_unknown_words_are_told(ros):
    with pytest.raises(ConfigError, match="cannot be published as 'fbx'; known: roots, tf, bodies, boxes"):
        PeopleNode(overrides={"publish": ["fbx"]})
    assert (*KINDS, "heat_maps") == PUBLISHABLE
