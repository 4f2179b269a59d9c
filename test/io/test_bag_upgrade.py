"""An older version's bag written anew opens without knowing of that version."""

import captures
import numpy as np
import pytest
from recordings import write_bag
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from panoptic_ros.errors import DataError
from panoptic_ros.io.bags import BagReader, upgrade
from panoptic_ros.io.messages import from_message
from panoptic_ros.io.messages.family import bag_typestore

OLD = {
    "AudioBlock": "std_msgs/Header header\nuint64 first_sample\nuint32 sample_rate\nfloat32[] samples\n",
    "ProposalSet": "std_msgs/Header header\nfloat64[] nodes\n",
}
FOREIGN = "uint8 apples\nstd_msgs/Header header\n"


def old_bag(path):
    """Sound, proposals and a message of another package, as an older version recorded them."""
    store = get_typestore(Stores.ROS2_JAZZY)
    types = dict(get_types_from_msg(FOREIGN, "fruit_msgs/msg/Basket"))
    for name, text in OLD.items():
        types |= get_types_from_msg(text, f"panoptic_msgs/msg/{name}")
    store.register(types)
    stamp = store.types["builtin_interfaces/msg/Time"](sec=1, nanosec=0)
    header = store.types["std_msgs/msg/Header"](stamp=stamp, frame_id="mic")
    rows = [
        (
            "/mic/audio",
            "panoptic_msgs/msg/AudioBlock",
            {"first_sample": 0, "sample_rate": 8000, "samples": np.ones(5, np.float32)},
        ),
        ("/proposals", "panoptic_msgs/msg/ProposalSet", {"nodes": np.zeros(3)}),
        ("/fruit", "fruit_msgs/msg/Basket", {"apples": 3}),
    ]
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        for k, (topic, kind, fields) in enumerate(rows):
            message = store.types[kind](header=header, **fields)
            bag.write(bag.add_connection(topic, kind, typestore=store), k, store.serialize_cdr(message, kind))
    return path


def test_messages_are_those_of_now_and_foreign_ones_are_copied(tmp_path):
    made = upgrade(old_bag(tmp_path / "bag"), tmp_path / "new")
    assert made.brought_up == ("/mic/audio",) and made.kept == ("/fruit",)
    assert made.left_out == {"/proposals": "panoptic_msgs/msg/ProposalSet"}
    with Reader(tmp_path / "new") as bag:
        digests = {c.msgtype: c.digest for c in bag.connections}
        basket = next(c for c in bag.connections if c.topic == "/fruit")
        assert "uint8 apples" in basket.msgdef.data
    sound = "panoptic_msgs/msg/AudioBlock"
    assert digests[sound] == bag_typestore().hash_rihs01(sound)
    with BagReader(tmp_path / "new") as bag:
        assert not any(bag.is_outdated(topic) for topic in bag.topics)
        (row,) = bag.messages("/mic/audio")
    assert from_message(row[2], "AudioBlock").samples.shape == (5, 1)


def test_nothing_is_written_where_nothing_is_old(tmp_path):
    write_bag(tmp_path / "bag", captures.views(1))
    assert upgrade(tmp_path / "bag", tmp_path / "new") is None
    assert not (tmp_path / "new").exists()


def test_what_is_there_is_not_overwritten(tmp_path):
    old_bag(tmp_path / "bag")
    (tmp_path / "new").mkdir()
    with pytest.raises(DataError, match="exists already"):
        upgrade(tmp_path / "bag", tmp_path / "new")
