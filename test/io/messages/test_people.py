"""People in other packages' messages, against the skeletons they come from."""

from dataclasses import replace

import captures
import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from panoptic_ros.domain import JointState, RefinedPoseSet
from panoptic_ros.io.messages.family import MessageFamily
from panoptic_ros.io.messages.people import (
    bodies_message,
    body_frame,
    boxes_message,
    joint_transforms,
    roots_message,
)
from panoptic_ros.io.messages.transforms import read_transform
from panoptic_ros.io.resources import share_folder

FOREIGN = {
    f"{package}/msg/{path.stem}": path.read_text()
    for package in ("hri_msgs", "vision_msgs")
    for path in sorted((share_folder() / "msg_defs" / "foreign" / package / "msg").glob("*.msg"))
}
STORE = get_typestore(Stores.ROS2_JAZZY)
STORE.register(
    {
        name: definition
        for kind, text in FOREIGN.items()
        for name, definition in get_types_from_msg(text, kind).items()
    }
)
FAMILY = MessageFamily(lambda name: STORE.types[name], lambda array: array)
NAMES = captures.SKELETON.joint_names


def poses(positions, ids=(4, 7)):
    positions = np.array(positions)
    there = np.isfinite(positions).all(-1)
    states = np.where(there, JointState.MEASURED, JointState.MISSING)
    covariances = np.where(there[..., None, None], np.eye(3), np.nan)
    return RefinedPoseSet(
        3,
        5_000_000_007,
        captures.SKELETON.hash,
        positions,
        covariances,
        there * 1.0,
        there * 4,
        states,
        np.full(len(there), 0.9),
        ids=np.array(ids),
    )


@pytest.fixture
def two():
    return poses(captures.people(0.4))


def test_bodies_stand_between_the_hips_and_look_ahead(two):
    message = roots_message(two, captures.SKELETON, "hall", FAMILY)
    assert message.header.frame_id == "hall" and message.header.stamp.nanosec == 7 and len(message.poses) == 2
    for k, person in enumerate(captures.people(0.4)):
        frame = body_frame(two, k, captures.SKELETON)
        hips = person[[NAMES.index("lHip"), NAMES.index("rHip")]].mean(0)
        np.testing.assert_allclose(frame.translation, hips)
        at = message.poses[k].position
        np.testing.assert_allclose([at.x, at.y, at.z], hips)
        nose = person[NAMES.index("Nose")] - person[NAMES.index("Neck")]
        forward, left, up = frame.rotation.T
        assert forward @ nose > 0.05 and up[2] > 0.99
        assert left @ (person[NAMES.index("lHip")] - hips) > 0.09


def test_who_has_no_root_is_left_out_and_who_has_no_torso_stands_upright(two):
    positions = np.array(two.positions)
    positions[0] = np.nan
    positions[1, [NAMES.index(n) for n in ("lHip", "lShoulder")]] = np.nan
    some = poses(positions)
    (pose,) = roots_message(some, captures.SKELETON, "hall", FAMILY).poses
    assert pose.orientation.w == 1.0
    root = positions[1, captures.SKELETON.root]
    np.testing.assert_allclose([pose.position.x, pose.position.y, pose.position.z], root)


def test_every_known_joint_has_a_frame_of_its_own(two):
    positions = np.array(two.positions)
    positions[0, 5] = np.nan
    rows = joint_transforms(poses(positions), captures.SKELETON, "hall", "lab/", FAMILY)
    found = {child: (parent, frame) for parent, child, frame in map(read_transform, rows)}
    assert len(found) == len(rows) == 2 * len(NAMES) - 1 + 2
    parent, frame = found["lab/p7_Nose"]
    assert parent == "hall" and f"lab/p4_{NAMES[5]}" not in found and "lab/body_p4" in found
    np.testing.assert_allclose(frame.translation, positions[1, NAMES.index("Nose")])


def test_who_is_there_as_rep_155_has_it(two):
    message = bodies_message(two, "hall", FAMILY)
    assert list(message.ids) == ["p4", "p7"] and message.header.stamp.sec == 5


def test_boxes_hold_all_joints(two):
    message = boxes_message(replace(two), "hall", FAMILY)
    assert [d.id for d in message.detections] == ["p4", "p7"]
    for detection, person in zip(message.detections, two.positions):
        at, size = detection.bbox.center.position, detection.bbox.size
        low = np.array([at.x, at.y, at.z]) - np.array([size.x, size.y, size.z]) / 2
        np.testing.assert_allclose(low, person.min(0) - 0.1)
        (result,) = detection.results
        assert result.hypothesis.class_id == "person" and result.hypothesis.score == 0.9
    assert STORE.serialize_cdr(message, message.__msgtype__)
