"""Clocks in the graph: models to sync, time references and diagnostics from it, and other sound messages."""

from types import SimpleNamespace

import captures
import numpy as np
import pytest
from spinning import spin_until

rclpy = pytest.importorskip("rclpy")
pytest.importorskip("panoptic_msgs")
from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from sensor_msgs.msg import TimeReference  # noqa: E402

from panoptic_ros.domain import ClockModel  # noqa: E402
from panoptic_ros.errors import DataError  # noqa: E402
from panoptic_ros.graph.flow import make_flow  # noqa: E402
from panoptic_ros.io.messages import from_message, to_message  # noqa: E402
from panoptic_ros.nodes.middleware.decoding import AudioDataReader, audio_common_class  # noqa: E402
from panoptic_ros.nodes.middleware.family import message_class, ros_messages  # noqa: E402
from panoptic_ros.nodes.middleware.quality import CLOCKS, data_quality  # noqa: E402
from panoptic_ros.nodes.sources.statics_node import StaticsNode  # noqa: E402
from panoptic_ros.nodes.stages.stage_node import StageNode  # noqa: E402

VIEW = message_class("panoptic_msgs/msg/ViewDetections")
SET = message_class("panoptic_msgs/msg/DetectionSet")
MODEL = message_class("panoptic_msgs/msg/ClockModel")
EPOCH = 1_700_000_000_000_000_001

pytestmark = pytest.mark.ros


@pytest.fixture
def tester(executor):
    """A node, and its executor."""
    node = rclpy.create_node("tester")
    executor.add_node(node)
    return node, executor


def test_sync_takes_clock_models_and_tells_of_them(tester):
    """The models come before the node is there, as they are latched, and before any frame."""
    tester, executor = tester
    models = tester.create_publisher(MODEL, "clock_models", CLOCKS)
    names = captures.RIG.names
    for k, name in enumerate(names):
        model = ClockModel(
            name, EPOCH, -EPOCH + k, 0.0, np.eye(2) * 1e-12, 0.0, EPOCH, EPOCH + 10**9, 1e-7, k
        )
        models.publish(to_message(model, ros_messages()))
    node = StageNode("sync", {"flow": "live", "deadline_s": 0.5, "clocks": [f"{n}={n}" for n in names]})
    statics = StaticsNode(captures.RIG, captures.SKELETON)
    quality = data_quality(make_flow("live"))
    publishers = {n: tester.create_publisher(VIEW, f"{n}/detections", quality) for n in names}
    sets, references, diagnostics = [], {}, {}
    tester.create_subscription(SET, "detection_sets", sets.append, 10)
    for name in names:
        heard = references.setdefault(name, [])
        tester.create_subscription(TimeReference, f"{name}/time_reference", heard.append, 10)
    tester.create_subscription(
        DiagnosticArray, "/diagnostics", lambda m: diagnostics.update({s.name: s for s in m.status}), 10
    )
    executor.add_node(node)
    executor.add_node(statics)
    spin_until(executor, lambda: all(p.get_subscription_count() for p in publishers.values()))
    spin_until(executor, lambda: sum("clock of" in n for n in diagnostics) == len(names))
    for index in range(1, 7):
        for k, camera in enumerate(captures.RIG.cameras):
            stamp = EPOCH - k + round(index * 1e9 / 30)
            publishers[camera.name].publish(to_message(captures.view(camera, index, stamp), ros_messages()))
        for _ in range(6):
            executor.spin_once(timeout_sec=0.05)
    spin_until(executor, lambda: len(sets) >= 3)
    item = from_message(sets[0], "DetectionSet")
    assert {view.stamp_ns for view in item.views} == {33_333_333} and item.stamp_ns == 33_333_333
    models.publish(
        to_message(ClockModel(names[0], EPOCH, -EPOCH, 0.0, np.eye(2), 0.0, EPOCH, EPOCH + 5), ros_messages())
    )
    spin_until(executor, lambda: any(m.time_ref.sec == 0 for m in references[names[0]]))
    reference = references[names[0]][-1]
    assert reference.header.stamp.sec == 1_700_000_000 and reference.header.frame_id == names[0]
    assert (reference.time_ref.sec, reference.time_ref.nanosec) == (0, 5)
    spin_until(executor, lambda: diagnostics[f"panoptic: clock of {names[0]}"].level == b"\x01")


def sound(samples, stamp_ns):
    seconds, nanoseconds = divmod(stamp_ns, 10**9)
    header = SimpleNamespace(stamp=SimpleNamespace(sec=seconds, nanosec=nanoseconds))
    data = list(np.asarray(samples, "<i2").tobytes())
    return SimpleNamespace(header=header, audio=SimpleNamespace(data=data))


def test_sound_without_a_count_becomes_blocks_with_gaps():
    reader = AudioDataReader("mic", 16_000, 2)
    stereo = np.stack([np.arange(1600), -np.arange(1600)], axis=1)
    first = reader.block(sound(stereo, EPOCH))
    assert first.samples[3].tolist() == [3 / 32768, -3 / 32768]
    assert (first.first_sample, first.stamp_ns) == (0, EPOCH)
    late = reader.block(sound(stereo, EPOCH + 120_000_000))  # a busy machine, nothing is lost
    assert late.first_sample == 1600
    lost = reader.block(sound(stereo, EPOCH + 120_000_000 + 1_100_000_000))
    assert lost.first_sample == 3200 + 16_000
    with pytest.raises(DataError, match="audio_channels"):
        reader.block(sound([1], EPOCH + 2 * 10**9))


def test_the_other_package_is_optional():
    assert audio_common_class() is None or audio_common_class().__name__ == "AudioDataStamped"
