"""Detection on the live graph: what tracking says comes back to it where looks are rationed, only there."""

from dataclasses import replace

import pytest
from blobs import SKELETON, Blobs
from spinning import spin_until
from stage_cases import CELLS, SECOND, known_people, watcher, watching_rig

rclpy = pytest.importorskip("rclpy")

from panoptic_ros.graph.flow import make_flow  # noqa: E402
from panoptic_ros.graph.topics import TOPICS  # noqa: E402
from panoptic_ros.io.messages import from_message, to_message  # noqa: E402
from panoptic_ros.io.messages.images import image_message  # noqa: E402
from panoptic_ros.nodes.middleware.family import message_class, ros_messages  # noqa: E402
from panoptic_ros.nodes.middleware.quality import data_quality  # noqa: E402
from panoptic_ros.nodes.sources.statics_node import StaticsNode  # noqa: E402
from panoptic_ros.nodes.stages.stage_node import StageNode  # noqa: E402

pytestmark = pytest.mark.ros
SIZES = {"input_side": 256, "smallest_input": 64, "adapt_input": False}
PLACES = 4.0 * CELLS + 1.5
PERIOD = 40_000_000


def start(executor, **parameters):
    """The node, publishers of the images of each camera and of tracks, and the detections that come."""
    rig = watching_rig()
    node = StageNode(
        "detection",
        {"flow": "live", **SIZES, **parameters},
        extras={"detection": lambda node, prefix, skeleton: watcher().extras},
    )
    statics, tester = StaticsNode(rig, SKELETON), rclpy.create_node("tester")
    quality, found = data_quality(make_flow("live")), []
    image = message_class(TOPICS["image"].message)
    images = {name: tester.create_publisher(image, TOPICS["image"].of(name), quality) for name in rig.names}
    tracks = tester.create_publisher(message_class(TOPICS["tracks"].message), TOPICS["tracks"].name, quality)
    for name in rig.names:
        kind = message_class(TOPICS["detections"].message)
        tester.create_subscription(kind, TOPICS["detections"].of(name), found.append, 10)
    for item in (node, statics, tester):
        executor.add_node(item)
    spin_until(executor, lambda: all(each.get_subscription_count() for each in images.values()))
    spin_until(executor, lambda: all(tester.count_publishers(TOPICS["detections"].of(n)) for n in rig.names))
    return node, images, tracks, found


def test_people_are_carried_once_tracking_knows_them(executor):
    node, images, tracks, found = start(executor, looks_per_s=9.0)
    spin_until(executor, lambda: tracks.get_subscription_count() == 1)
    picture = Blobs.picture((192, 256), PLACES, 4.0)
    for k in range(12):
        stamp = SECOND + k * PERIOD
        for name, publisher in images.items():
            frame = replace(Blobs.frame(picture, k, name), stamp_ns=stamp)
            publisher.publish(image_message(frame, ros_messages()))
        spin_until(executor, lambda k=k: len(found) >= 3 * (k + 1))
        tracks.publish(to_message(known_people(PLACES, stamp, k), ros_messages()))
        for _ in range(4):
            executor.spin_once(timeout_sec=0.02)
    views = [from_message(message, "ViewDetections") for message in found[18:]]
    assert all(len(view.points) == 2 for view in views)
    carried = [view for view in views if view.carried is not None]
    assert 0.3 < len(carried) / len(views) < 0.8
    assert all(0.0 < age <= 0.13 for view in carried for age in view.carried)
    assert node.healthy and not node.statistics["detection"].dropped


def test_without_that_nobody_subscribes_to_tracks(executor):
    _, _, tracks, _ = start(executor)
    assert tracks.get_subscription_count() == 0
