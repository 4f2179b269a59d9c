"""Bags appear whole or not at all, and damaged ones are refused in one line."""

from concurrent.futures import ThreadPoolExecutor

import captures
import numpy as np
import pytest
from recordings import write_bag
from rosbags.rosbag2 import StoragePlugin, Writer

from panoptic_ros.errors import DataError
from panoptic_ros.io.bags import BagReader, BagWriter
from panoptic_ros.io.messages import bag_messages, from_message, to_message
from panoptic_ros.io.messages.family import bag_typestore


def test_round_trip_in_the_order_of_stamps(tmp_path):
    views = captures.views(3)
    path = write_bag(tmp_path / "bag", views)
    with BagReader(path) as bag:
        assert bag.topics["/rig"] == "panoptic_msgs/msg/Rig" and bag.counts["/cam1/detections"] == 3
        back = [from_message(m, "ViewDetections") for _, _, m in bag.messages("/cam1/detections")]
        stamps = [stamp for _, stamp, _ in bag.messages()]
    assert [v.stamp_ns for v in back] == [v.stamp_ns for v in views if v.camera == "cam1"]
    assert stamps == sorted(stamps)


def test_an_error_leaves_nothing(tmp_path):
    with pytest.raises(RuntimeError, match="mine"), BagWriter(tmp_path / "bag") as bag:
        bag.write("/rig", 0, to_message(captures.RIG, bag_messages()))
        raise RuntimeError("mine")
    assert list(tmp_path.iterdir()) == []


def test_does_not_overwrite(tmp_path):
    path = write_bag(tmp_path / "bag", [])
    with pytest.raises(DataError, match="exists already"):
        BagWriter(path)


def test_no_bag(tmp_path):
    with pytest.raises(DataError, match="there is no bag"):
        BagReader(tmp_path / "no")
    with pytest.raises(DataError, match="cannot be read as a rosbag2"):
        BagReader(tmp_path)


def test_damaged_storage(tmp_path):
    path = write_bag(tmp_path / "bag", captures.views(20))
    storage = next(path.glob("*.mcap"))
    data = storage.read_bytes()
    rng = np.random.default_rng(0)
    damaged = [data[: len(data) // 2], data[:1000] + bytes(len(data) - 2000) + data[-1000:]]
    for _ in range(40):
        changed = np.frombuffer(data, np.uint8).copy()
        changed[rng.integers(0, len(data), 30)] = rng.integers(0, 256, 30)
        damaged.append(changed.tobytes())
    refused = 0
    for content in damaged:
        storage.write_bytes(content)
        try:
            with BagReader(path) as bag:
                list(bag.messages())
        except DataError as error:
            assert "bag" in str(error) and "\n" not in str(error)
            refused += 1
    assert refused > len(damaged) // 2


def test_damaged_metadata_is_told_in_one_line(tmp_path):
    path = write_bag(tmp_path / "bag", [])
    (path / "metadata.yaml").write_text("a: [1\nb: {\n")
    with pytest.raises(DataError, match="metadata") as told:
        BagReader(path)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_threads_read_topics_of_one_bag_side_by_side(tmp_path, storage):
    topics, random = [f"/camera{k}" for k in range(4)], np.random.default_rng(0)
    with Writer(tmp_path / "bag", version=9, storage_plugin=storage) as bag:
        kind, store = "sensor_msgs/msg/CompressedImage", bag_typestore()
        made = [bag.add_connection(topic, kind, typestore=store) for topic in topics]
        for k in range(80):
            bag.write(made[k % 4], k, random.bytes(200_000))
    with BagReader(tmp_path / "bag") as reader, ThreadPoolExecutor(4) as threads:

        def read(topic):
            return [(stamp, bytes(data)) for _, stamp, data, _ in reader.raw(topic)]

        assert list(threads.map(read, topics)) == [read(topic) for topic in topics]
