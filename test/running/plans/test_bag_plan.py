"""Bags from elsewhere: topics of other names, several bags, missing facts, stamps that mean nothing."""

import gzip
import json
from dataclasses import replace

import captures
import cv2
import numpy as np
import pytest
from recordings import write_bag
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from panoptic_ros.cli.main import main
from panoptic_ros.domain import ViewFrame
from panoptic_ros.io.bags import BagReader, BagWriter
from panoptic_ros.io.messages import bag_messages, compressed_image_message, to_message
from panoptic_ros.io.models import DEFAULT_MODEL, is_cached, read_card
from panoptic_ros.io.rigs import write_rig
from panoptic_ros.io.skeletons import map_joints

needs_model = pytest.mark.skipif(
    not is_cached(read_card(DEFAULT_MODEL)), reason="the default model is not fetched (panoptic models fetch)"
)
POSES = "rpt_msgs/msg/Poses"
POSES_DEFINITION = (
    "std_msgs/Header header\nfloat32[] bodies_flat\nint32[] bodies_shape\nstring[] joint_names\n"
    "string extra_data\n"
)
VIEWS = captures.views(12)


def run(tmp_path, *arguments):
    """Exit code, and the skeletons as text if there are any."""
    out = tmp_path / "out"
    code = main(["run", *map(str, arguments), "--out", str(out), "--no-pictures", "--in-process"])
    result = out / "skeletons.json.gz"
    return code, gzip.decompress(result.read_bytes()).decode() if result.exists() else ""


def renamed(path, source, name):
    """A copy of a bag with other topics."""
    with BagReader(source) as old, BagWriter(path) as new:
        for topic, stamp, data, kind in old.raw():
            new.write_raw(name(topic), kind, stamp, bytes(data))
    return path


@pytest.fixture
def bag(tmp_path):
    return write_bag(tmp_path / "bag", VIEWS)


@pytest.fixture
def usual(tmp_path, bag):
    (tmp_path / "usual").mkdir()
    code, result = run(tmp_path / "usual", "--bag", bag)
    assert code == 0 and len(json.loads(result)["frames"]) == 12
    return result


def test_topics_in_a_namespace(tmp_path, bag, usual):
    other = renamed(tmp_path / "b", bag, lambda topic: "/lab" + topic if "detections" in topic else topic)
    assert run(tmp_path, "--bag", other) == (0, usual)


def test_two_topics_that_may_be_a_cameras(tmp_path, capsys):
    with BagWriter(tmp_path / "b") as bag:
        bag.write("/rig", 0, to_message(captures.RIG, bag_messages()))
        for space in ("/a", "/b"):
            for view in VIEWS:
                message = to_message(view, bag_messages())
                bag.write(f"{space}/{view.camera}/detections", view.stamp_ns, message)
    assert run(tmp_path, "--bag", tmp_path / "b")[0] == 2
    error = capsys.readouterr().err
    assert "/a/cam0/detections" in error and "--topic cam0=" in error


def test_named_topics(tmp_path, capsys, bag, usual):
    other = renamed(tmp_path / "b", bag, lambda topic: topic.replace("/detections", "_seen"))
    assert run(tmp_path, "--bag", other)[0] == 2
    error = capsys.readouterr().err
    assert "--topic CAMERA=TOPIC" in error and "/cam1_seen" in error
    named = [word for name in captures.RIG.names for word in ("--topic", f"{name}=/{name}_seen")]
    assert run(tmp_path, "--bag", other, *named) == (0, usual)
    assert run(tmp_path, "--bag", other, "--topic", "cam9=/cam1_seen")[0] == 2
    assert "cam9" in capsys.readouterr().err
    assert run(tmp_path, "--bag", other, "--topic", "cam1=/nothing")[0] == 2
    assert "no topic /nothing" in capsys.readouterr().err
    swapped = ["--topic", "cam0=/cam1_seen", "--topic", "cam1=/cam0_seen"]
    assert run(tmp_path, "--bag", other, *swapped)[0] == 2
    assert "detections of camera cam1, not of cam0" in capsys.readouterr().err


def test_two_bags_of_one_capture(tmp_path, capsys, bag, usual):
    halves = [write_bag(tmp_path / k, [v for v in VIEWS if v.camera in k]) for k in ("cam0cam2", "cam1cam3")]
    assert run(tmp_path, "--bag", halves[0], "--bag", halves[1]) == (0, usual)
    assert run(tmp_path, "--bag", halves[0], "--bag", bag)[0] == 2
    assert "camera cam0 may be" in capsys.readouterr().err


def test_skeleton_model_that_was_not_recorded(tmp_path, capsys, bag, usual):
    bare = write_bag(tmp_path / "b", VIEWS, skeleton=None)
    assert run(tmp_path, "--bag", bare) == (0, usual)
    assert run(tmp_path, "--bag", bare, "--skeleton", "coco17")[0] == 2
    assert "/skeleton_model" in capsys.readouterr().err


def test_skeleton_as_the_default_model_fills_it(tmp_path):
    filled, _ = map_joints("panoptic19", read_card(DEFAULT_MODEL).card.joints)
    views = [replace(view, skeleton_hash=filled.hash) for view in VIEWS]
    assert run(tmp_path, "--bag", write_bag(tmp_path / "b", views, skeleton=None))[0] == 0


def write_foreign_bag(path, views, topic="/poses/{}", values=3):
    """What a recording of RapidPoseTriangulation has: its own message, defined in the bag, and no rig."""
    at = captures.SKELETON.joint_names.index
    sides = {"left": "l", "right": "r"}
    joints = {
        f"{joint}_{side}": at(letter + joint.title())
        for side, letter in sides.items()
        for joint in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
    } | {"nose": at("Nose")}
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(POSES_DEFINITION, POSES))
    types = store.types
    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as bag:
        connections = {
            name: bag.add_connection(topic.format(name), POSES, typestore=store)
            for name in captures.RIG.names
        }
        for view in views:
            seconds, rest = divmod(view.stamp_ns, 10**9)
            stamp = types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=rest)
            bodies = np.concatenate([view.points, view.scores[..., None]], -1)[:, [*joints.values()]]
            bodies = np.nan_to_num(np.pad(bodies, ((0, 0), (0, 0), (0, values - 3))).astype(np.float32))
            message = types[POSES](
                header=types["std_msgs/msg/Header"](stamp=stamp, frame_id="other"),
                extra_data="",
                bodies_flat=bodies.ravel(),
                bodies_shape=np.array(bodies.shape, np.int32),
                joint_names=list(joints),
            )
            bag.write(connections[view.camera], view.stamp_ns, store.serialize_cdr(message, POSES))
    return path


@pytest.mark.parametrize("topic", ["/poses/{}", "/{}/people"])
def test_people_of_another_stack(tmp_path, capsys, usual, topic):
    bag, rig = write_foreign_bag(tmp_path / "b", VIEWS, topic), tmp_path / "rig.json"
    assert run(tmp_path, "--bag", bag)[0] == 2 and "--rig" in capsys.readouterr().err
    write_rig(rig, captures.RIG)
    code, result = run(tmp_path, "--bag", bag, "--rig", rig)
    assert code == 0
    (names, own), (other_names, theirs) = (
        (a["joint_names"], [{p["id"]: p["joints"] for p in frame["skeletons"]} for frame in a["frames"]])
        for a in map(json.loads, (usual, result))
    )
    assert [set(frame) for frame in theirs] == [set(frame) for frame in own]
    for joint in ("rWrist", "lAnkle", "lHip"):
        here, there = own[5][0][names.index(joint)], theirs[5][0][other_names.index(joint)]
        assert np.linalg.norm(np.subtract(here, there)) < 0.02


def test_people_of_another_stack_in_3d(tmp_path, capsys):
    write_rig(tmp_path / "rig.json", captures.RIG)
    bag = write_foreign_bag(tmp_path / "b", VIEWS, values=4)
    assert run(tmp_path, "--bag", bag, "--rig", tmp_path / "rig.json")[0] == 2
    assert "/poses/cam0" in (error := capsys.readouterr().err) and "3D poses" in error


def test_stamps_that_stand_still(tmp_path, capsys):
    with BagWriter(tmp_path / "b") as bag:
        for view in VIEWS:
            message = to_message(replace(view, stamp_ns=0), bag_messages())
            bag.write(f"/{view.camera}/detections", 10**9 + view.stamp_ns, message)
    write_rig(tmp_path / "rig.json", captures.RIG)
    arguments = ["--bag", tmp_path / "b", "--rig", tmp_path / "rig.json"]
    assert run(tmp_path, *arguments)[0] == 2
    assert "all stamps are 0 s; add --arrival-stamps" in capsys.readouterr().err
    code, result = run(tmp_path, *arguments, "--arrival-stamps")
    frames = json.loads(result)["frames"]
    assert code == 0 and [frame["stamp_ns"] - 10**9 for frame in frames] == [v.stamp_ns for v in VIEWS[::4]]


def test_clocks_that_share_no_instant(tmp_path, capsys):
    with BagWriter(tmp_path / "b") as bag:
        bag.write("/rig", 0, to_message(captures.RIG, bag_messages()))
        for view in VIEWS:
            late = replace(view, stamp_ns=view.stamp_ns + (3600 * 10**9 if view.camera == "cam2" else 0))
            bag.write(f"/{view.camera}/detections", view.stamp_ns, to_message(late, bag_messages()))
    assert run(tmp_path, "--bag", tmp_path / "b")[0] == 2
    error = capsys.readouterr().err
    assert "camera cam2 begin 3600.0 s after" in error and "--arrival-stamps" in error


def test_bad_messages_are_counted(tmp_path, bag):
    with BagReader(bag) as old, BagWriter(tmp_path / "b") as new:
        for k, (topic, stamp, data, kind) in enumerate(old.raw()):
            new.write_raw(topic, kind, stamp, bytes(data) if k != 12 else bytes(data)[:6])
    assert run(tmp_path, "--bag", tmp_path / "b")[0] == 0
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["frames"]["dropped"] == {"sync: bad_message": 1}


@needs_model
class TestImages:
    def bag(self, path, size, change=lambda message: message):
        with BagWriter(path) as bag:
            bag.write("/rig", 0, to_message(captures.RIG, bag_messages()))
            for name in captures.RIG.names:
                image = np.zeros((size[1], size[0], 3), np.uint8)
                message = compressed_image_message(ViewFrame(name, 0, 0, image), bag_messages(), 90)
                bag.write(f"/{name}/image_raw/compressed", 0, change(message))
        return path

    def test_of_another_size_than_calibrated(self, tmp_path, capsys):
        assert run(tmp_path, "--bag", self.bag(tmp_path / "b", (640, 360)))[0] == 2
        error = capsys.readouterr().err
        assert "640x360" in error and "1280x720" in error and "cam0" in error and "size policy" in error

    def test_that_nothing_can_decode(self, tmp_path, capsys):
        def broken(message):
            return replace(message, format="h264", data=np.arange(100, dtype=np.uint8))

        assert run(tmp_path, "--bag", self.bag(tmp_path / "b", (1280, 720), broken))[0] == 2
        assert "h264" in capsys.readouterr().err

    def test_skeleton_for_detections_is_not_asked_for(self, tmp_path):
        assert run(tmp_path, "--bag", self.bag(tmp_path / "b", (1280, 720)))[0] == 0

    @pytest.mark.parametrize("in_process", [True, False])
    def test_with_compressed_depth_maps(self, tmp_path, in_process, capsys):
        path = self.bag(tmp_path / "images", (1280, 720))
        levels = np.full((90, 160), 3000, np.uint16)
        packed = np.concatenate([np.zeros(12, np.uint8), cv2.imencode(".png", levels)[1].reshape(-1)])
        with BagReader(path) as old, BagWriter(tmp_path / "b") as new:
            for topic, stamp, data, kind in old.raw():
                new.write_raw(topic, kind, stamp, bytes(data))
            for name, topic, how in (
                ("cam0", "/cam0/depth_registered/image_raw/compressedDepth", "png"),
                ("cam1", "/elsewhere/compressedDepth", "png"),
                ("cam2", "/lab/cam2/depth_registered/image_raw/compressedDepth", "lz4"),
            ):
                message = compressed_image_message(
                    ViewFrame(name, 0, 0, np.zeros((8, 8, 3), np.uint8)), bag_messages(), 90
                )
                new.write(topic, 0, replace(message, format=f"16UC1; compressedDepth {how}", data=packed))
        named = "--depth-topic", "cam1=/elsewhere/compressedDepth"
        out, way = tmp_path / "out", ["--in-process"] if in_process else []
        given = ["--bag", str(tmp_path / "b"), *named, "--out", str(out), "--no-pictures"]
        assert main(["run", *given, *way]) == 0
        said = "".join(capsys.readouterr())
        assert "camera cam2 goes without its depth maps" in said and "lz4" in said
        with BagReader(out / "bag") as bag:
            limits = {
                topic.split("/")[1]: message.limit_rows
                for topic, _, message in bag.messages()
                if topic.endswith("/detections")
            }
        assert limits["cam0"] and limits["cam1"] and not limits["cam2"] and not limits["cam3"]
        assert main(["run", "--bag", str(path), *named, "--out", str(out)]) == 2
        assert "no depth maps on /elsewhere" in capsys.readouterr().err
