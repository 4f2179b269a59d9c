"""2D people of another stack, by its own message definition, in a bag of its own."""

from types import SimpleNamespace

import captures
import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from panoptic_ros.errors import DataError
from panoptic_ros.io.bag_connections import types_of
from panoptic_ros.io.bags import BagReader
from panoptic_ros.io.messages.family import decode_cdr
from panoptic_ros.io.messages.rpt import KIND, view_of_poses
from panoptic_ros.io.resources import share_folder

CAMERA = "cam0", captures.RIG.camera("cam0").image_size
NAMES = ["nose", "shoulder_left", "shoulder_right", "hip_left", "hip_right", "hip_middle", "head"]
DEFINITION = (
    "std_msgs/Header header\nfloat32[] bodies_flat\nint32[] bodies_shape\nstring[] joint_names\n"
    "string extra_data\n"
)


def message(bodies, names=NAMES, shape=None):
    header = SimpleNamespace(stamp=SimpleNamespace(sec=2, nanosec=3), frame_id="other")
    bodies = np.asarray(bodies, np.float32)
    shape = bodies.shape if shape is None else shape
    return SimpleNamespace(
        header=header, bodies_flat=bodies.ravel(), bodies_shape=list(shape), joint_names=names, extra_data=""
    )


def some(people=2):
    bodies = np.random.default_rng(1).uniform(10, 700, (people, len(NAMES), 3))
    bodies[..., 2] = 0.8
    return bodies


def test_joints_are_found_by_their_names():
    bodies = some()
    bodies[1, 0, 2] = 0.0
    view = view_of_poses(message(bodies), *CAMERA, 7, "panoptic19")
    assert (view.camera, view.stamp_ns, view.frame_number) == ("cam0", 2 * 10**9 + 3, 7)
    assert view.image_size == (1280, 720)
    at = captures.SKELETON.joint_names.index
    np.testing.assert_allclose(view.points[0, at("rShoulder")], bodies[0, 2, :2], rtol=1e-6)
    np.testing.assert_allclose(view.points[0, at("Neck")], bodies[0, 1:3, :2].mean(0), rtol=1e-6)
    assert np.isnan(view.points[1, at("Nose")]).all() and view.scores[1, at("Nose")] == 0
    assert np.isnan(view.points[0, at("lKnee")]).all()
    assert view.person_scores.tolist() == pytest.approx([0.8, 0.8])


def test_nobody_is_nobody():
    assert len(view_of_poses(message(some(0)), *CAMERA, 0, "panoptic19").person_scores) == 0


def test_what_does_not_fit_is_told():
    with pytest.raises(DataError, match="4 values per joint: these are 3D poses"):
        view_of_poses(message(np.zeros((1, len(NAMES), 4))), *CAMERA, 0, "panoptic19")
    with pytest.raises(DataError, match=r"bodies_shape \[3, 7, 3\] does not fit 7 joint names and 42 values"):
        view_of_poses(message(some(), shape=(3, 7, 3)), *CAMERA, 0, "panoptic19")
    with pytest.raises(DataError, match="does not fit 2 joint names"):
        view_of_poses(message(some(), names=["nose", "head"]), *CAMERA, 0, "panoptic19")


def test_a_bag_of_that_stack_is_read_by_the_definition_inside(tmp_path):
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(DEFINITION, KIND))
    stamp = store.types["builtin_interfaces/msg/Time"](sec=2, nanosec=3)
    bodies = some().astype(np.float32)
    poses = store.types[KIND](
        header=store.types["std_msgs/msg/Header"](stamp=stamp, frame_id="c"),
        bodies_flat=bodies.ravel(),
        bodies_shape=np.array(bodies.shape, np.int32),
        joint_names=NAMES,
        extra_data="",
    )
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3) as bag:
        connection = bag.add_connection("/poses/cam0", KIND, typestore=store)
        bag.write(connection, 5, store.serialize_cdr(poses, KIND))
    with BagReader(tmp_path / "bag") as bag:
        types = types_of(KIND, bag.connection("/poses/cam0").definition)
        ((_, _, data, kind),) = bag.raw()
    view = view_of_poses(decode_cdr(data, kind, types), *CAMERA, 0, "panoptic19")
    assert len(view.person_scores) == 2


def test_the_definition_that_is_shipped_is_the_same():
    shipped = share_folder() / "msg_defs" / "foreign" / "rpt_msgs" / "msg" / "Poses.msg"
    if not shipped.is_file():
        pytest.skip("part of the checkout only")
    assert shipped.read_text() == DEFINITION
