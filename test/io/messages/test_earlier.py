"""Bags of before sound had channels still tell what they held."""
import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from panoptic_ros.errors import DataError
from panoptic_ros.io.bags import BagReader
from panoptic_ros.io.messages import from_message
from panoptic_ros.io.messages.earlier import EARLIER

SAMPLES = np.linspace(-1, 1, 30).astype(np.float32)


def write(path, kind, definition, **fields):
    """A bag with one message as another version defined it."""
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(definition, kind))
    stamp = store.types["builtin_interfaces/msg/Time"](sec=7, nanosec=5)
    header = store.types["std_msgs/msg/Header"](stamp=stamp, frame_id="mic")
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        connection = bag.add_connection("/mic/topic", kind, typestore=store)
        message = store.types[kind](header=header, **fields)
        bag.write(connection, 1, store.serialize_cdr(message, kind))
    return path


def only_record(path, record):
    with BagReader(path) as bag:
        (found,) = bag.messages("/mic/topic")
    return from_message(found[2], record)


def test_sound_of_one_channel(tmp_path):
    path = write(tmp_path / "bag", "panoptic_msgs/msg/AudioBlock", EARLIER["AudioBlock"][0],
                 first_sample=48, sample_rate=48_000, samples=SAMPLES)  # fmt: skip
    block = only_record(path, "AudioBlock")
    assert (block.device, block.stamp_ns, block.first_sample, block.clocks) == ("mic", 7 * 10**9 + 5, 48, ())
    np.testing.assert_array_equal(block.samples, SAMPLES[:, None])


def test_readings_without_a_clock(tmp_path):
    path = write(tmp_path / "bag", "panoptic_msgs/msg/TimecodeReading", EARLIER["TimecodeReading"][0],
                 hours=1, minutes=2, seconds=3, frames=4, rate_numerator=25, rate_denominator=1,
                 drop_frame=False, start_sample=12.25, std_samples=0.5, reverse=False,
                 user_bits=9)  # fmt: skip
    reading = only_record(path, "TimecodeReading")
    assert (str(reading.timecode), reading.clock, reading.sample_rate) == ("01:02:03:04", "", 0)
    assert (reading.start_sample, reading.user_bits) == (12.25, 9)


def test_other_versions_are_refused(tmp_path):
    path = write(tmp_path / "bag", "panoptic_msgs/msg/AudioBlock", "std_msgs/Header header\nfloat32 gain\n",
                 gain=1.0)  # fmt: skip
    with BagReader(path) as bag, pytest.raises(DataError, match="another version"):
        next(bag.messages("/mic/topic"))
