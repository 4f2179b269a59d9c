"""Cameras that a node reads itself: the records of detection as without messages, images for who asks."""

import time
from contextlib import ExitStack
from pathlib import Path

import cv2
import numpy as np
import pytest
from blobs import SKELETON, Blobs
from spinning import spin_until
from stage_cases import CELLS, content, watcher, watching_rig

rclpy = pytest.importorskip("rclpy")

from panoptic_ros.capture import open_recording  # noqa: E402
from panoptic_ros.detection.config import DetectionConfig  # noqa: E402
from panoptic_ros.detection.stage import DetectionStage  # noqa: E402
from panoptic_ros.domain import AudioBlock  # noqa: E402
from panoptic_ros.graph.flow import make_flow  # noqa: E402
from panoptic_ros.graph.topics import TOPICS  # noqa: E402
from panoptic_ros.io.messages import from_message, to_message  # noqa: E402
from panoptic_ros.nodes.middleware.family import message_class, ros_messages  # noqa: E402
from panoptic_ros.nodes.middleware.quality import data_quality  # noqa: E402
from panoptic_ros.nodes.sources.statics_node import StaticsNode  # noqa: E402
from panoptic_ros.nodes.stages.own_cameras import OwnCameras  # noqa: E402
from panoptic_ros.nodes.stages.stage_node import StageNode  # noqa: E402

pytestmark = pytest.mark.ros
SIZES = {"input_side": 256, "smallest_input": 64, "adapt_input": False}
COUNT = 5


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Descriptions of three cameras with a few images each."""
    found, root = {}, tmp_path_factory.mktemp("images")
    for c, name in enumerate(watching_rig().names):
        (root / name).mkdir()
        for k in range(COUNT):
            picture = Blobs.picture((192, 256), 4.0 * CELLS + 1.5 + 2 * k + c, 4.0)
            cv2.imwrite(str(root / name / f"{k:03d}.png"), picture)
        found[name] = {"kind": "file", "path": str(root / name), "frame_rate": 25.0}
    return found


def start(executor, own, flow, subscribed=()):
    """The node, and what comes by topic: detections of all cameras, and what is subscribed to besides."""
    rig = watching_rig()
    node = StageNode(
        "detection",
        {"flow": flow, **SIZES},
        extras={"detection": lambda node, prefix, skeleton: watcher().extras},
        own=own,
    )
    statics, tester, found = StaticsNode(rig, SKELETON), rclpy.create_node("tester"), {}
    quality = data_quality(make_flow(flow))
    for key, camera in (*(("detections", name) for name in rig.names), *subscribed):
        came = found[key, camera] = []
        kind = message_class(TOPICS[key].message)
        tester.create_subscription(kind, TOPICS[key].of(camera), came.append, quality)
    for item in (tester, node, statics):
        executor.add_node(item)
    return node, found


def test_recordings_give_what_the_stage_gives_and_nobody_is_sent_images(executor, folders):
    node, found = start(executor, OwnCameras(folders, threads=2), "replay", [("preview", "left")])
    spin_until(executor, lambda: all(len(found["detections", name]) == COUNT for name in folders))
    alone = DetectionStage(DetectionConfig(**SIZES), watcher())
    with ExitStack() as stack:
        records = open_recording(watching_rig(), folders, stack, [].append)
        for name in folders:
            views = [from_message(message, "ViewDetections") for message in found["detections", name]]
            expected = []
            for frame in records["image", name]:
                (view,) = alone.step(frame).outputs
                expected.append(from_message(to_message(view, ros_messages()), "ViewDetections"))
            assert content(tuple(views)) == content(tuple(expected))
            assert all(len(view.points) == 2 for view in views)
    assert len(found["preview", "left"]) == 2  # ten a second, of 25
    assert node.count_publishers("/left/image_raw") == 1 and node.healthy
    spin_until(executor, lambda: node.statistics["detection"].taken == 3 * COUNT)


def test_the_sound_of_a_device_that_is_named_as_a_camera_comes_as_a_message(executor, folders):
    stages = ["detection", "timecode", "clocks", "sync"]
    sizes = {f"detection.{name}": value for name, value in SIZES.items()}
    node = StageNode(
        stages,
        {"flow": "replay", "devices": ["left"], **sizes},
        extras={"detection": lambda node, prefix, skeleton: watcher().extras},
        own=OwnCameras(folders),
    )
    tester = rclpy.create_node("tester")
    quality = data_quality(make_flow("replay"), sound=True)
    sound = tester.create_publisher(message_class("panoptic_msgs/msg/AudioBlock"), "left/audio", quality)
    for item in (tester, node, StaticsNode(watching_rig(), SKELETON)):
        executor.add_node(item)
    spin_until(executor, lambda: sound.get_subscription_count() == 1)
    for k in range(4):
        block = AudioBlock("left", k * 10**8, 1600 * k, 16_000, np.zeros(1600, np.float32))
        sound.publish(to_message(block, ros_messages()))
    spin_until(executor, lambda: node.statistics["timecode"].taken >= 3)
    assert node.healthy


def test_live_cameras_are_taken_as_they_come_and_images_sent_to_who_asks(executor, folders):
    begin = time.time_ns()
    played = {
        name: {"kind": "played", "path": str(Path(own["path"]).parent), "rate_hz": 20.0, "start_ns": begin}
        for name, own in folders.items()
    }
    asked = [("image", "right"), ("camera_info", "right")]
    node, found = start(executor, OwnCameras(played, threads=2), "live", asked)
    spin_until(executor, lambda: all(len(found[key]) >= 3 for key in found))
    views = [from_message(message, "ViewDetections") for message in found["detections", "right"]]
    assert all(len(view.points) == 2 for view in views)
    stamps = {name: {m.header.stamp.nanosec for m in found["detections", name]} for name in folders}
    assert stamps["left"] & stamps["right"] & stamps["third"]
    image, info = found["image", "right"][-1], found["camera_info", "right"][-1]
    assert (image.width, image.height, info.width) == (256, 192, 256)
    assert node.healthy


def test_a_camera_that_cannot_be_opened_ends_the_node(executor, folders, tmp_path):
    sources = {**folders, "third": {"kind": "file", "path": str(tmp_path / "gone.mp4")}}
    for flow in ("replay", "live"):
        node, _ = start(executor, OwnCameras(sources), flow)
        spin_until(executor, lambda node=node: not node.healthy)
        assert "gone.mp4" in str(node.fault)
        for other in executor.get_nodes():
            executor.remove_node(other)
            getattr(other, "close", lambda: None)()
            other.destroy_node()
