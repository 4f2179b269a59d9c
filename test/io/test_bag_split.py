"""A recording in parts: each a bag by itself, and no message is lost between two."""

import pytest
from rosbags.rosbag2 import Reader

from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.io.bag_recorder import BagRecorder
from panoptic_ros.io.bag_split import SplitLimits, split_of
from panoptic_ros.io.definitions import described
from panoptic_ros.io.messages.family import bag_typestore

KIND = "std_msgs/msg/String"
SECOND = 1_000_000_000


@pytest.mark.parametrize("split, parts", [(SplitLimits(seconds=2.0), 5), (SplitLimits(size=500), 4)])
def test_every_part_stands_alone_and_all_messages_are_there_once(tmp_path, split, parts):
    store, topic, first = bag_typestore(), described("/numbers", KIND), described("/first", KIND)

    def cdr(text):
        return bytes(store.serialize_cdr(store.types[KIND](data=text), KIND))

    recorder = BagRecorder(tmp_path / "day", 0, 0, split, lambda: [(first, cdr("again"))])
    sent = [f"{k:030d}" for k in range(40)]
    for k, text in enumerate(sent):
        recorder.put(topic, k * SECOND // 4, cdr(text))
    recorder.close()
    bags = sorted((tmp_path / "day").iterdir())
    assert [bag.name for bag in bags] == [f"{k:03d}" for k in range(parts)]
    came = []
    for number, path in enumerate(bags):
        with Reader(path) as bag:
            rows = [(c.topic, store.deserialize_cdr(data, KIND).data) for c, _, data in bag.messages()]
        assert ("/first", "again") in rows or number == 0
        came += [text for name, text in rows if name == "/numbers"]
    assert came == sent and recorder.counters["/numbers"].count == len(sent)
    with pytest.raises(DataError, match="exists already"):
        BagRecorder(tmp_path / "day", 0, 0, split)


def test_splits_are_times_or_sizes():
    assert split_of("30m") == SplitLimits(seconds=1800.0) and split_of("1.5h") == SplitLimits(seconds=5400.0)
    assert split_of("2GB") == SplitLimits(size=2_000_000_000) and split_of(".5MB") == SplitLimits(
        size=500_000
    )
    for words in ("", "30", "GB", "0s", "-1h", "2 GB", "1d"):
        with pytest.raises(UsageError, match="give a time or a size"):
            split_of(words)
