"""Replays keep the times of the bag at any rate, and begin at any stage."""

import itertools
import threading
import time

import captures
import pytest
from mcap_files import Channel, text, write_mcap
from recordings import write_bag

rclpy = pytest.importorskip("rclpy")
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402

from panoptic_ros.errors import DataError, EnvironmentProblem, UsageError  # noqa: E402
from panoptic_ros.nodes.middleware.family import message_class  # noqa: E402
from panoptic_ros.nodes.middleware.quality import LATCHED  # noqa: E402
from panoptic_ros.running.recordings import replay as replays  # noqa: E402
from panoptic_ros.running.recordings.replay import ReplayOptions, chosen_topics, replay, topics_from  # noqa: E402  # noqa: E402

pytestmark = pytest.mark.ros
VIEWS = "panoptic_msgs/msg/ViewDetections"


@pytest.fixture(scope="module")
def people(tmp_path_factory):
    return write_bag(tmp_path_factory.mktemp("people") / "bag", captures.views(31))


class Listener:
    """A node on the time of the bag, in a context and a thread of its own."""

    def __init__(self, topic, latched="/rig"):
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        override = [Parameter("use_sim_time", value=True)]
        self.node = rclpy.create_node("listener", context=self.context, parameter_overrides=override)
        self.seen, self.latched = [], []
        self.node.create_subscription(message_class(VIEWS), topic, self._take, 100)
        kind = message_class("panoptic_msgs/msg/Rig")
        self.node.create_subscription(kind, latched, self.latched.append, LATCHED)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.thread = threading.Thread(target=self._spin)
        self.stop = threading.Event()
        self.thread.start()

    def _spin(self):
        while not self.stop.is_set():
            self.executor.spin_once(timeout_sec=0.02)

    def _take(self, message):
        stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        self.seen.append((stamp, self.node.get_clock().now().nanoseconds * 1e-9, time.monotonic()))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.stop.set()
        self.thread.join()
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()


@pytest.mark.parametrize("rate", [0.5, 4.0])
def test_nodes_live_in_the_time_of_the_bag(people, rate):
    with Listener("/hall/cam0/detections", "/hall/rig") as listener:
        options = ReplayOptions(rate=rate, clock=True, space="/hall", begin="detections", wait_s=20)
        done = replay([people], options, lambda line: None)
        end = time.monotonic() + 5
        while len(listener.seen) < 31 and time.monotonic() < end:
            time.sleep(0.02)
    assert done.count == 31 * 4 + 2 and len(listener.seen) == 31 and len(listener.latched) == 1
    stamps = [stamp for stamp, _, _ in listener.seen]
    assert stamps == sorted(stamps)
    lags = sorted(now - stamp for stamp, now, _ in listener.seen)
    assert abs(lags[len(lags) // 2]) < 0.1 * max(1.0, rate)  # the clock goes with the messages
    lasted = listener.seen[-1][2] - listener.seen[0][2]
    assert lasted * rate == pytest.approx(1.0, abs=0.3 * max(1.0, rate))


def test_a_part_of_the_bag(people):
    with Listener("/cam0/detections") as listener:
        options = ReplayOptions(rate=10, start_s=0.5, duration_s=0.2, patterns=["/cam0/*", "/rig"], wait_s=20)
        done = replay([people], options, lambda line: None)
        end = time.monotonic() + 5
        while len(listener.seen) < 6 and time.monotonic() < end:
            time.sleep(0.02)
    assert [round(30 * stamp) for stamp, _, _ in listener.seen] == list(range(15, 21))
    assert set(done.topics) == {"/cam0/detections", "/rig"} and len(listener.latched) == 1


def test_stamps_run_on_from_one_loop_to_the_next(people):
    with Listener("/cam0/detections") as listener:
        options = ReplayOptions(rate=10, loops=3, patterns=["/cam0/*", "/rig"], wait_s=20, clock=True)
        replay([people], options, lambda line: None)
        end = time.monotonic() + 5
        while len(listener.seen) < 93 and time.monotonic() < end:
            time.sleep(0.02)
    stamps = [stamp for stamp, _, _ in listener.seen]
    assert len(stamps) == 93
    steps = [b - a for a, b in itertools.pairwise(stamps)]
    assert min(steps) > 0 and max(steps) < 0.04  # also where a loop begins


def test_nobody_there_is_told(people, monkeypatch):
    monkeypatch.setattr(replays, "DISCOVERY_S", 0.1)
    with pytest.raises(EnvironmentProblem, match=r"no node subscribes .* within 0.2 s"):
        replay([people], ReplayOptions(wait_s=0.2), lambda line: None)


def test_what_is_not_there_is_told(people):
    with pytest.raises(DataError, match="no such topics; there are /cam0/detections"):
        replay([people], ReplayOptions(begin="image"), lambda line: None)
    with pytest.raises(UsageError, match="no such topic or stage; topics are image"):
        replay([people], ReplayOptions(begin="skeleton"), lambda line: None)
    with pytest.raises(DataError, match="more than one"):
        replay([people, people], ReplayOptions(), lambda line: None)


def test_data_that_cannot_be_published_end_in_one_line(tmp_path):
    topics = [Channel("/tf_static"), Channel("/fruit", kind="fruit_msgs/msg/Basket")]
    path = write_mcap(tmp_path / "x.mcap", topics, [(0, 1, text("a")), (1, 2, text("b"))])
    told = []
    with pytest.raises(DataError, match="only latched topics can be published here"):
        replay([path], ReplayOptions(), told.append)
    assert told == ["/fruit is left out: its messages, fruit_msgs/msg/Basket, are not installed here"]


def test_a_graph_that_begins_later_needs_less():
    facts = {"rig", "skeleton_model", "clock_models", "subjects"}
    assert topics_from("detections") == facts | {"detections"}
    assert topics_from("sync") == topics_from("detection_sets") == facts | {"detection_sets"}
    assert topics_from("image") >= {"image", "compressed_image", "depth"} | facts
    assert "detections" not in topics_from("image")


def test_topics_are_told_apart_in_any_namespace():
    image = "sensor_msgs/msg/Image"
    there = {
        "/hall/cam0/image_raw": image,
        "/hall/k/depth/image_raw": image,
        "/hall/cam0/depth_registered/image_raw": image,
        "/a": image,
    }
    assert chosen_topics(there, {"image"}) == ["/hall/cam0/image_raw"]
    assert chosen_topics(there, {"sensor_depth"}) == ["/hall/k/depth/image_raw"]
