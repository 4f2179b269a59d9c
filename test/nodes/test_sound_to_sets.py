"""From sound to sets through the nodes, while blocks are lost and nodes are started anew."""

import captures
import numpy as np
import pytest
from spinning import spin_until

rclpy = pytest.importorskip("rclpy")
pytest.importorskip("panoptic_msgs")
from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from sensor_msgs.msg import TimeReference  # noqa: E402

from panoptic_ros.domain import AudioBlock, Timecode  # noqa: E402
from panoptic_ros.graph.flow import make_flow  # noqa: E402
from panoptic_ros.io.messages import from_message, to_message  # noqa: E402
from panoptic_ros.nodes.middleware.family import message_class, ros_messages  # noqa: E402
from panoptic_ros.nodes.middleware.quality import data_quality  # noqa: E402
from panoptic_ros.nodes.sources.statics_node import StaticsNode  # noqa: E402
from panoptic_ros.nodes.stages.stage_node import StageNode  # noqa: E402
from panoptic_ros.simulation.ltc_signal import encode_ltc, timecode_rate  # noqa: E402

pytestmark = pytest.mark.ros
SECOND = 10**9
EPOCH = 1_700_000_000 * SECOND
SAMPLES, BLOCK = 16_000, 640  # a block and a frame every 40 ms
FIRST_LABEL = 90_000  # an hour after midnight
SLOW = 1 + 40e-6  # device seconds in a true one


class Lab:
    """A generator that a microphone hears, and the cameras of the rig on the microphone's clock."""

    def __init__(self, executor):
        self.executor, self.tester = executor, rclpy.create_node("lab")
        flow = make_flow("live")
        kinds = {"audio": "AudioBlock", "view": "ViewDetections", "set": "DetectionSet"}
        kinds = {key: message_class(f"panoptic_msgs/msg/{name}") for key, name in kinds.items()}
        self.sound = self.tester.create_publisher(kinds["audio"], "mic/audio", data_quality(flow, sound=True))
        self.cameras = {
            name: self.tester.create_publisher(kinds["view"], f"{name}/detections", data_quality(flow))
            for name in captures.RIG.names
        }
        self.sets, self.references, self.status = [], [], {}
        self.tester.create_subscription(kinds["set"], "detection_sets", self.sets.append, 100)
        self.tester.create_subscription(TimeReference, "mic/time_reference", self.references.append, 100)
        self.tester.create_subscription(
            DiagnosticArray, "/diagnostics", lambda m: self.status.update({s.name: s for s in m.status}), 100
        )
        label = Timecode.from_frame_count(FIRST_LABEL, timecode_rate("25"))
        signal = encode_ltc(label, 300, SAMPLES, lead=0.0)
        self.samples = signal.samples.astype(np.float32)
        self.nodes, self.block = {}, 0
        executor.add_node(self.tester)
        self.statics = StaticsNode(captures.RIG, captures.SKELETON)
        executor.add_node(self.statics)
        self.start("timecode", "clocks", "sync")

    def start(self, *stages):
        for stage in stages:
            own = {"sync": {"clocks": ["*=mic"], "deadline_s": 0.5}}.get(stage, {"devices": ["mic"]})
            self.nodes[stage] = StageNode(stage, {"flow": "live", **own})
            self.executor.add_node(self.nodes[stage])
        spin_until(self.executor, self.all_heard)
        for _ in range(5):
            self.executor.spin_once(timeout_sec=0.02)

    def all_heard(self):
        topics = ["mic/audio", "mic/timecode", "clock_models", *(f"{n}/detections" for n in self.cameras)]
        return all(self.tester.count_subscribers(t) and self.tester.count_publishers(t) for t in topics)

    def stop(self, stage):
        node = self.nodes.pop(stage)
        self.executor.remove_node(node)
        node.close()
        node.destroy_node()
        spin_until(self.executor, lambda: not self.all_heard())

    def go(self, seconds, silent=False):
        """Time goes on: a block of sound, and a frame of every camera at its beginning."""
        for _ in range(round(25 * seconds)):
            first = self.block * BLOCK
            stamp = EPOCH + round(first * SECOND / SAMPLES * SLOW)
            if not silent:
                item = AudioBlock("mic", stamp, first, SAMPLES, self.samples[first : first + BLOCK])
                self.sound.publish(to_message(item, ros_messages()))
            for camera in captures.RIG.cameras:
                view = captures.view(camera, self.block, stamp)
                self.cameras[camera.name].publish(to_message(view, ros_messages()))
            self.block += 1
            self.wait_for(len(self.cameras))

    def wait_for(self, views):
        """Live queues are short: sync takes these before the next come."""
        sync = self.nodes["sync"].statistics["sync"]
        wanted = sync.taken + views
        spin_until(self.executor, lambda: sync.taken >= wanted)

    def settle(self):
        for _ in range(10):
            self.executor.spin_once(timeout_sec=0.05)

    def values(self, stage):
        """What a node says of itself on /diagnostics."""
        status = self.status.get(f"panoptic: {stage}")
        return {} if status is None else {v.key: v.value for v in status.values}

    def error_s(self, item):
        """Stamp of a set less the master time of the frames in it."""
        true = {view.frame_number / 25 for view in item.views}
        assert len(true) == 1, "frames of different instants"
        return item.stamp_ns / SECOND - FIRST_LABEL / 25 - true.pop()


@pytest.fixture
def lab(executor):
    return Lab(executor)


def test_lost_sound_is_told_once_and_nodes_that_start_anew_find_back(lab, capfd):
    lab.go(2.5)
    lab.go(0.04, silent=True)
    lab.go(1.0)
    spin_until(lab.executor, lambda: "notice.timecode.gap" in lab.values("timecode"))
    assert capfd.readouterr().err.count("timecode.gap") == 1
    values = lab.values("timecode")
    assert values["notice.timecode.gap"] == "1" and "mic lost 640 samples" in values["latest.timecode.gap"]
    for stage in ("timecode", "clocks"):
        lab.stop(stage)
        lab.start(stage)
        lab.go(1.5)
    lab.settle()
    before = len(lab.sets)
    lab.stop("sync")
    lab.start("sync")
    lab.go(1.0)
    lab.settle()
    assert len(lab.sets) - before >= 18  # the model of before is latched
    sets = [from_message(item, "DetectionSet") for item in lab.sets]
    assert max(abs(lab.error_s(item)) for item in sets) < 1e-4
    numbers = [view.frame_number for item in sets for view in item.views]
    assert len(numbers) == len(set(numbers)) * len(captures.RIG.names)
    assert len(set(numbers)) >= lab.block - 40  # all but the first ones, and those that the old sync held
    assert np.diff(sorted(set(numbers))).max() < 25
    reference = lab.references[-1]
    device = reference.header.stamp.sec * SECOND + reference.header.stamp.nanosec
    master = reference.time_ref.sec * SECOND + reference.time_ref.nanosec
    assert master == pytest.approx(FIRST_LABEL * SECOND // 25 + (device - EPOCH) / SLOW, abs=1e5)
