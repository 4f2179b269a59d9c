"""Bags of earlier versions still tell what they held, by the definitions that they keep inside."""

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from panoptic_ros.errors import DataError
from panoptic_ros.io.bags import BagReader
from panoptic_ros.io.messages import from_message

SOUND = "std_msgs/Header header\nuint64 first_sample\nuint32 sample_rate\nfloat32[] samples\n"
READING = (
    "std_msgs/Header header\nuint8 hours\nuint8 minutes\nuint8 seconds\nuint8 frames\n"
    "uint32 rate_numerator\nuint32 rate_denominator\nbool drop_frame\nfloat64 start_sample\n"
    "float64 std_samples\nbool reverse\nuint32 user_bits\n"
)
CAMERA = (
    "string name\nuint32 width\nuint32 height\nfloat64[9] matrix\nfloat64[5] distortion\n"
    "float64[9] rotation\nfloat64[3] translation\n"
)
CLOCK = "std_msgs/Header header\nfloat64 offset_ns\nfloat64 drift\nfloat64[4] covariance\n"
PROPOSALS = "std_msgs/Header header\nfloat64[] nodes\nint32[] node_joints\n"
PERSON = (
    "int64 id\nfloat64 score\nfloat64[] positions\nfloat64[] covariances\nfloat64[] scores\n"
    "int32[] views\nuint8[] states\n"
)
SAMPLES = np.linspace(-1, 1, 30).astype(np.float32)


def store_of(**definitions):
    store = get_typestore(Stores.ROS2_JAZZY)
    types = {}
    for name, text in definitions.items():
        types |= get_types_from_msg(text, f"panoptic_msgs/msg/{name}")
    store.register(types)
    return store


def make(store, name, /, **fields):
    return store.types[name if "/" in name else f"panoptic_msgs/msg/{name}"](**fields)


def header_of(store, frame="mic"):
    stamp = make(store, "builtin_interfaces/msg/Time", sec=7, nanosec=5)
    return make(store, "std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def write_message(path, store, message):
    """A bag with one message as another version defined it."""
    kind = message.__msgtype__
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        connection = bag.add_connection("/mic/topic", kind, typestore=store)
        bag.write(connection, 1, store.serialize_cdr(message, kind))
    return path


def write(path, kind, definition, **fields):
    """The same, of a message with a header."""
    store = store_of(**{kind.split("/")[-1]: definition})
    return write_message(path, store, make(store, kind, header=header_of(store), **fields))


def only_record(path, record):
    with BagReader(path) as bag:
        (found,) = bag.messages("/mic/topic")
    return from_message(found[2], record)


def test_sound_of_one_channel(tmp_path):
    path = write(
        tmp_path / "bag",
        "panoptic_msgs/msg/AudioBlock",
        SOUND,
        first_sample=48,
        sample_rate=48_000,
        samples=SAMPLES,
    )
    block = only_record(path, "AudioBlock")
    assert (block.device, block.stamp_ns, block.first_sample, block.clocks) == ("mic", 7 * 10**9 + 5, 48, ())
    np.testing.assert_array_equal(block.samples, SAMPLES[:, None])


def test_readings_without_a_clock(tmp_path):
    path = write(
        tmp_path / "bag",
        "panoptic_msgs/msg/TimecodeReading",
        READING,
        hours=1,
        minutes=2,
        seconds=3,
        frames=4,
        rate_numerator=25,
        rate_denominator=1,
        drop_frame=False,
        start_sample=12.25,
        std_samples=0.5,
        reverse=False,
        user_bits=9,
    )
    reading = only_record(path, "TimecodeReading")
    assert (str(reading.timecode), reading.clock, reading.sample_rate) == ("01:02:03:04", "", 0)
    assert (reading.start_sample, reading.user_bits) == (12.25, 9)


def test_other_versions_are_refused(tmp_path):
    path = write(
        tmp_path / "bag", "panoptic_msgs/msg/AudioBlock", "std_msgs/Header header\nfloat32 gain\n", gain=1.0
    )
    with BagReader(path) as bag, pytest.raises(DataError, match="another version"):
        next(bag.messages("/mic/topic"))


def test_a_rig_of_before_lenses_had_names(tmp_path):
    store = store_of(Camera=CAMERA, Rig="std_msgs/Header header\nCamera[] cameras\n")
    camera = make(
        store,
        "Camera",
        name="left",
        width=640,
        height=480,
        matrix=np.diag([500.0, 500, 1]).reshape(9),
        distortion=np.array([0.1, 0, 0, 0, 0.2]),
        rotation=np.eye(3).reshape(9),
        translation=np.ones(3),
    )
    path = write_message(
        tmp_path / "bag", store, make(store, "Rig", header=header_of(store, "hall"), cameras=[camera])
    )
    rig = only_record(path, "Rig")
    found = rig.camera("left")
    assert rig.frame_id == "hall" and rig.occluders is None and rig.depth_sensors == ()
    assert found.intrinsics.lens == "brown" and found.covariance is None and found.line_delay_us == 0
    np.testing.assert_array_equal(found.intrinsics.distortion, [0.1, 0, 0, 0, 0.2])


def test_a_clock_whose_offset_was_a_float(tmp_path):
    model = only_record(
        write(
            tmp_path / "bag",
            "panoptic_msgs/msg/ClockModel",
            CLOCK,
            offset_ns=1_000_000.4,
            drift=1e-6,
            covariance=np.zeros(4),
        ),
        "ClockModel",
    )
    assert model.offset_ns == 1_000_000 and model.drift == 1e-6
    assert model.master_from_device(10**15) == pytest.approx((10**15 + 1_000_000 + 999_993_000, 0), abs=1)


def test_skeletons_of_before_they_said_how_many_joints_they_have(tmp_path):
    store = store_of(
        Skeleton=PERSON,
        Skeletons="std_msgs/Header header\nuint64 index\nstring skeleton_hash\nSkeleton[] skeletons\n",
    )
    person = make(
        store,
        "Skeleton",
        id=4,
        score=0.5,
        positions=np.arange(6.0),
        covariances=np.zeros(18),
        scores=np.ones(2),
        views=np.array([3, 2], np.int32),
        states=np.ones(2, np.uint8),
    )
    message = make(
        store, "Skeletons", header=header_of(store), index=3, skeleton_hash="x", skeletons=[person]
    )
    poses = only_record(write_message(tmp_path / "bag", store, message), "RefinedPoseSet")
    assert poses.ids.tolist() == [4] and poses.newest_ns == poses.stamp_ns == 7 * 10**9 + 5
    np.testing.assert_array_equal(poses.positions[0], np.arange(6.0).reshape(2, 3))
    assert poses.sources is None and poses.side_votes is None and poses.time_shift is None


def test_proposals_without_what_they_were_made_from_are_refused(tmp_path):
    path = write(
        tmp_path / "bag",
        "panoptic_msgs/msg/ProposalSet",
        PROPOSALS,
        nodes=np.zeros(3),
        node_joints=np.zeros(1, np.int32),
    )
    with BagReader(path) as bag, pytest.raises(DataError, match="another version .* ProposalSet"):
        next(bag.messages("/mic/topic"))
