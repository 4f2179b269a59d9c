"""/skeletons in other words, by real subscribers."""

from xml.etree import ElementTree

import captures
import numpy as np
import pytest
from bodies import BODY, MODEL, placed, some_pose
from spinning import spin_until

rclpy = pytest.importorskip("rclpy")

from panoptic_ros.cli.run.usage import PUBLISHABLE  # noqa: E402
from panoptic_ros.domain import JointState, RefinedPoseSet  # noqa: E402
from panoptic_ros.domain.body_names import link_names  # noqa: E402
from panoptic_ros.domain.subjects import BodyState  # noqa: E402
from panoptic_ros.errors import ConfigError  # noqa: E402
from panoptic_ros.io.messages import bag_messages, to_message  # noqa: E402
from panoptic_ros.io.messages.people import segment_transforms  # noqa: E402
from panoptic_ros.io.messages.transforms import read_transform  # noqa: E402
from panoptic_ros.kinematics.body_records import SolvedBody, body_set  # noqa: E402
from panoptic_ros.nodes.listeners.people_node import KINDS, OF_BODIES, PeopleNode  # noqa: E402
from panoptic_ros.nodes.middleware.family import message_class, ros_messages  # noqa: E402
from panoptic_ros.nodes.middleware.quality import LATCHED  # noqa: E402

pytestmark = pytest.mark.ros


def people():
    positions = captures.people(0.2)
    shape = positions.shape[:2]
    return RefinedPoseSet(
        0,
        5,
        captures.SKELETON.hash,
        positions,
        np.broadcast_to(np.eye(3), (*shape, 3, 3)),
        np.ones(shape),
        np.full(shape, 4),
        np.full(shape, JointState.MEASURED),
        np.ones(2),
        ids=np.array([1, 12]),
    )


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
    assert (*KINDS, *OF_BODIES, "heat_maps") == PUBLISHABLE


def bodies():
    frames, places = placed(some_pose(1))
    body = SolvedBody(BodyState(5, 4, places, frames), BODY, 2, 4, 0)
    return body_set(0, 5, 5, MODEL, captures.SKELETON, [body])


def heard_of_bodies(executor, node, topic, kind, quality=10):
    other = rclpy.create_node("other")
    executor.add_node(node)
    executor.add_node(other)
    seen = []
    other.create_subscription(message_class(kind), topic, seen.append, quality)
    publisher = other.create_publisher(message_class("panoptic_msgs/msg/Bodies"), "bodies", 10)
    message = to_message(bodies(), ros_messages(), "hall")

    def done():
        publisher.publish(message)
        return bool(seen)

    spin_until(executor, done)
    return seen[0]


def test_joint_angles_come_with_the_description_that_they_belong_to(executor):
    node = PeopleNode(overrides={"publish": ["joints"]})
    state = heard_of_bodies(executor, node, "/humans/bodies/p4/joint_states", "sensor_msgs/msg/JointState")
    frames, _ = placed(some_pose(1))
    assert list(state.name)[:3] == [f"{name}_p4" for name in MODEL.joint_names[:3]]
    assert np.array(state.position) == pytest.approx(MODEL.joint_angles(frames), abs=1e-9)
    text = node.get_parameter("human_description_p4").value
    joints = [joint.get("name") for joint in ElementTree.fromstring(text).findall("joint")]
    assert joints == list(state.name)


def test_the_description_is_latched(executor):
    node = PeopleNode(overrides={"publish": ["joints"]})
    message = heard_of_bodies(executor, node, "/humans/bodies/p4/urdf", "std_msgs/msg/String", LATCHED)
    assert message.data == node.get_parameter("human_description_p4").value


def test_segments_in_tf_add_up_to_the_body(executor):
    pytest.importorskip("tf2_msgs", reason="./run messages tf2_msgs builds them")
    node = PeopleNode(overrides={"publish": ["segments", "tf"]})
    message = heard_of_bodies(executor, node, "/tf", KINDS["tf"][1])
    check_transforms(message.transforms)


def check_transforms(transforms):
    frames, places = placed(some_pose(1))
    found = {"hall": (np.eye(3), np.zeros(3))}
    for transform in transforms:
        parent, child, pose = read_transform(transform)
        turn, at = found[parent]
        found[child] = turn @ pose.rotation, at + turn @ pose.translation
    for s, name in enumerate(link_names(MODEL, "p4")):
        assert found[name][1] == pytest.approx(places[s], abs=1e-9)
        assert found[name][0] == pytest.approx(frames[s], abs=1e-9)


def test_segments_are_a_tree_of_transforms():
    check_transforms(segment_transforms(bodies(), MODEL, "hall", "", bag_messages()))
