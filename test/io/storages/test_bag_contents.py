"""Bags of any writer are read completely; a line reports all messages that are left out or missing."""

import shutil
import sqlite3
from concurrent.futures import ThreadPoolExecutor

import captures
import numpy as np
import pytest
import yaml
from backports import zstd
from mcap_files import TEXT, Channel, Layout, text, write_mcap
from recordings import write_bag
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from panoptic_ros.errors import DataError
from panoptic_ros.io.bags import BagReader, PartBagWarning, is_bag
from panoptic_ros.io.messages import from_message
from panoptic_ros.io.messages.family import bag_typestore

TOPICS = (Channel("/a"), Channel("/b"))
ROWS = [(k % 2, 100 + k, text(f"message {k}")) for k in range(30)]
SHUFFLED = [ROWS[k] for k in (3, 1, 2, 0, *range(29, 3, -1))]
LAYOUTS = {
    "as usual": Layout(),
    "zstd": Layout(compression="zstd"),
    "chunk index without message index": Layout(message_index=False),
    "the same without statistics": Layout(message_index=False, statistics=False),
    "no statistics": Layout(statistics=False),
    "no chunk index": Layout(chunk_index=False),
    "channels not repeated": Layout(repeated=False),
    "statistics alone": Layout(chunk_index=False, repeated=False),
    "no summary": Layout(summary=False),
    "no chunks": Layout(chunk=0),
    "no chunks, no summary": Layout(chunk=0, summary=False),
    "empty profile": Layout(profile=""),
    "another profile": Layout(profile="x-jobs"),
}


def content(path):
    """Return all messages of texts: topic, stamp, bytes."""
    with BagReader(path) as bag:
        rows = [(topic, stamp, bytes(data)) for topic, stamp, data, kind in bag.raw() if kind == TEXT]
        assert sum(bag.counts.values()) == len(rows)
        if rows:
            assert bag.begin_ns == rows[0][1] and bag.end_ns > rows[-1][1]
    return rows


def expected(rows=ROWS):
    return [(TOPICS[channel].topic, stamp, data) for channel, stamp, data in sorted(rows, key=lambda r: r[1])]


def text_bag(path, rows=ROWS, plugin=StoragePlugin.MCAP, mode=CompressionMode.NONE):
    """Write a bag by rosbags."""
    writer = Writer(path, version=9, storage_plugin=plugin)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        made = [writer.add_connection(c.topic, TEXT, typestore=bag_typestore()) for c in TOPICS]
        for channel, stamp, data in rows:
            writer.write(made[channel], stamp, data)
    return path


def edited(bag, change):
    """Return the bag after a change of its metadata."""
    path = bag / "metadata.yaml"
    document = yaml.safe_load(path.read_text())
    change(document["rosbag2_bagfile_information"])
    path.write_text(yaml.safe_dump(document))
    return bag


def storage_of(bag):
    return next(path for path in bag.iterdir() if path.name != "metadata.yaml")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("rows", [ROWS, SHUFFLED], ids=["in order", "not in order"])
@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_a_file_of_any_layout_gives_all_messages_in_their_order(tmp_path, layout, rows):
    path = write_mcap(tmp_path / "x.mcap", TOPICS, rows, layout)
    assert content(path) == expected()
    with BagReader(path) as bag:
        assert [row[1] for row in bag.raw("/b", begin_ns=103, end_ns=110)] == [103, 105, 107, 109]
        assert bag.connection("/a").definition == "string data"


@pytest.mark.parametrize("layout", [Layout(), Layout(chunk=0), Layout(summary=False)])
def test_threads_read_topics_of_a_file_of_any_layout_side_by_side(tmp_path, layout):
    path = write_mcap(tmp_path / "x.mcap", TOPICS, ROWS * 40, layout)
    with BagReader(path) as bag, ThreadPoolExecutor(2) as threads:
        both = list(threads.map(lambda topic: [row[:3] for row in bag.raw(topic)], ("/a", "/b")))
        assert both == [[row[:3] for row in bag.raw(topic)] for topic in ("/a", "/b")]
    assert len(both[0]) == 15 * 40


def test_statistics_that_count_more_are_told(tmp_path):
    path = write_mcap(tmp_path / "x.mcap", TOPICS, ROWS, Layout(stated=12))
    with pytest.warns(PartBagWarning, match="the statistics of x.mcap count 42 messages, it holds 30"):
        assert content(path) == expected()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("plugin", list(StoragePlugin))
@pytest.mark.parametrize("quality", ["- history: 1\n  depth: 5", [{"history": 9}], "none: [", 3])
def test_words_of_qos_in_the_metadata_hide_no_message(tmp_path, plugin, quality):
    def change(about):
        for topic in about["topics_with_message_count"]:
            topic["topic_metadata"]["offered_qos_profiles"] = quality

    assert content(edited(text_bag(tmp_path / "bag", plugin=plugin), change)) == expected()


def test_counts_of_the_metadata_that_differ_are_told(tmp_path):
    def change(about):
        about["topics_with_message_count"][0]["message_count"] = 20

    bag = edited(text_bag(tmp_path / "bag"), change)
    with pytest.warns(PartBagWarning, match=r"metadata.yaml counts 35 messages, there are 30: /a 15 of 20"):
        assert content(bag) == expected()


class TestSplit:
    """Bags of several files."""

    @pytest.fixture
    def bag(self, tmp_path):
        """Three files, of which the second has other QoS, and the third begins before the second ends."""
        parts = ROWS[:10], [*ROWS[10:20], ROWS[25]], [*ROWS[20:25], *ROWS[26:]]
        bag = text_bag(tmp_path / "bag")
        storage_of(bag).unlink()
        quality = (("offered_qos_profiles", "- history: 1\n  depth: 3"),)
        for k, rows in enumerate(parts):
            topics = [c if k != 1 else Channel(c.topic, about=quality) for c in TOPICS]
            write_mcap(bag / f"bag_{k}.mcap", topics, rows)
        names = [f"bag_{k}.mcap" for k in range(3)]
        return edited(bag, lambda about: about.update(relative_file_paths=names))

    @pytest.mark.filterwarnings("error")
    def test_all_files_are_read_in_one_order(self, bag):
        assert content(bag) == expected()

    def test_a_missing_file_is_told_with_what_it_held(self, bag):
        (bag / "bag_1.mcap").unlink()
        with pytest.warns(PartBagWarning) as told:
            rows = content(bag)
        lines = [str(each.message) for each in told]
        assert len(rows) == 19 and "bag_1.mcap is missing, which metadata.yaml names" in lines[0]
        assert "metadata.yaml counts 30 messages, there are 19" in lines[1]

    def test_a_file_that_is_not_named_is_told(self, bag):
        shutil.copy(bag / "bag_0.mcap", bag / "bag_3.mcap")
        with pytest.warns(PartBagWarning, match="bag_3.mcap is not read, as metadata.yaml does not name it"):
            assert content(bag) == expected()

    def test_files_that_were_renamed_are_read(self, bag):
        for k in range(3):
            (bag / f"bag_{k}.mcap").rename(bag / f"take_{k}.mcap")
        with pytest.warns(PartBagWarning, match="bag_0.mcap.*does not exist; take_0.mcap.*is read"):
            assert content(bag) == expected()

    @pytest.mark.filterwarnings("error")
    def test_files_that_were_packed_or_unpacked_by_hand_are_read(self, bag):
        (bag / "bag_0.mcap.zstd").write_bytes(zstd.compress((bag / "bag_0.mcap").read_bytes()))
        (bag / "bag_0.mcap").unlink()
        names = ["bag_0.mcap", "bag_1.mcap.zstd", "bag_2.mcap"]
        assert content(edited(bag, lambda about: about.update(relative_file_paths=names))) == expected()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("plugin", list(StoragePlugin))
@pytest.mark.parametrize("mode", [CompressionMode.FILE, CompressionMode.MESSAGE])
def test_packed_bags_and_their_files_alone(tmp_path, plugin, mode):
    bag = text_bag(tmp_path / "bag", plugin=plugin, mode=mode)
    assert content(bag) == expected() and content(storage_of(bag)) == expected()
    assert is_bag(bag) and is_bag(storage_of(bag)) and not is_bag(tmp_path)


@pytest.mark.filterwarnings("error")
def test_a_packed_file_in_several_frames(tmp_path):
    whole = write_mcap(tmp_path / "x.mcap", TOPICS, ROWS).read_bytes()
    (tmp_path / "y.mcap.zst").write_bytes(zstd.compress(whole[:900]) + zstd.compress(whole[900:]))
    assert content(tmp_path / "y.mcap.zst") == expected()


def test_a_packed_file_that_was_cut_names_the_remedy(tmp_path):
    whole = zstd.compress(write_mcap(tmp_path / "x.mcap", TOPICS, ROWS).read_bytes())
    (tmp_path / "y.mcap.zstd").write_bytes(whole[:-20])
    with pytest.raises(DataError, match=r"it was cut.*`panoptic bag repair .*y.mcap.zstd`"):
        BagReader(tmp_path / "y.mcap.zstd")


class TestOtherSerializations:
    """Messages that are not CDR."""

    TOPICS = (
        *TOPICS,
        Channel("/json", "json", "Thing", "jsonschema", "{}"),
        Channel("/proto", "protobuf", "foxglove.Thing", "protobuf", "\x01"),
        Channel("/bare", kind=""),
        Channel("/shape", "cdr", "a/msg/B", "protobuf", ""),
    )
    ROWS = [*ROWS, *((2 + k % 4, 200 + k, b'{"a": 1}') for k in range(8))]

    def test_their_topics_are_left_out_and_named(self, tmp_path):
        path = write_mcap(tmp_path / "x.mcap", self.TOPICS, self.ROWS)
        with pytest.warns(PartBagWarning, match="only messages of ROS 2 are read") as told:
            assert content(path) == expected()
        line = str(told[0].message)
        assert "/json (JSON); /proto (protobuf); /bare (CDR of no stated type); /shape (CDR of pro" in line

    @pytest.mark.parametrize(
        ("topic", "told"),
        [
            (Channel("/j", "json", "Thing", "jsonschema"), r"but /j \(JSON\); record with ROS 2"),
            (Channel("/v", "protobuf", "foxglove.CompressedVideo", "protobuf"), r"/v \(protobuf video\)"),
            (Channel("/r", "ros1", "std_msgs/String", "ros1msg"), r"/r \(ROS 1\); convert .*rosbags-convert"),
        ],
    )
    def test_nothing_else_is_refused(self, tmp_path, topic, told):
        path = write_mcap(tmp_path / "x.mcap", [topic], [(0, 1, b"x")], Layout(profile=topic.message))
        with pytest.raises(DataError, match=told):
            BagReader(path)

    def test_in_sqlite(self, tmp_path):
        bag = text_bag(tmp_path / "bag", plugin=StoragePlugin.SQLITE3)
        base = sqlite3.connect(storage_of(bag))
        base.execute("UPDATE topics SET serialization_format = 'json' WHERE name = '/b'")
        base.execute("UPDATE message_definitions SET encoding = 'unknown'")
        base.execute("UPDATE topics SET offered_qos_profiles = 'no: [qos'")
        base.commit()
        base.close()
        with pytest.warns(PartBagWarning, match=r"left out: /b \(JSON\)"):
            assert content(bag) == [row for row in expected() if row[0] == "/a"]


@pytest.mark.parametrize("as_folder", [False, True])
def test_a_bag_of_ros_1_is_named_with_the_remedy(tmp_path, as_folder):
    path = tmp_path / "take.bag"
    path.write_bytes(b"#ROSBAG V2.0\n" + bytes(4096))
    with pytest.raises(DataError, match=r"take.bag is a bag of ROS 1; .*`rosbags-convert --src .*take.bag"):
        BagReader(tmp_path if as_folder else path)


def test_messages_in_a_journal_are_told(tmp_path):
    bag = text_bag(tmp_path / "bag", plugin=StoragePlugin.SQLITE3)
    storage = storage_of(bag)
    storage.with_name(storage.name + "-wal").write_bytes(b"journal")
    with pytest.warns(PartBagWarning, match=r"messages that are in .*-wal alone are not read"):
        assert content(bag) == expected()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("alone", [True, False])
def test_an_older_version_is_brought_up_also_from_its_file_alone(tmp_path, alone):
    store = get_typestore(Stores.ROS2_JAZZY)
    kind = "panoptic_msgs/msg/AudioBlock"
    definition = "std_msgs/Header header\nuint64 first_sample\nuint32 sample_rate\nfloat32[] samples\n"
    store.register(get_types_from_msg(definition, kind))
    stamp = store.types["builtin_interfaces/msg/Time"](sec=1, nanosec=0)
    header = store.types["std_msgs/msg/Header"](stamp=stamp, frame_id="mic")
    samples = np.ones(5, np.float32)
    message = store.types[kind](header=header, first_sample=0, sample_rate=8000, samples=samples)
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        made = bag.add_connection("/mic/audio", kind, typestore=store)
        bag.write(made, 0, store.serialize_cdr(message, kind))
    path = storage_of(tmp_path / "bag") if alone else tmp_path / "bag"
    with BagReader(path) as bag:
        assert bag.is_outdated("/mic/audio")
        (row,) = bag.messages("/mic/audio")
    assert from_message(row[2], "AudioBlock").samples.shape == (5, 1)


@pytest.mark.filterwarnings("error")
def test_a_file_of_this_version_alone_is_not_outdated(tmp_path):
    path = storage_of(write_bag(tmp_path / "bag", captures.views(2)))
    with BagReader(path) as bag:
        assert not any(bag.is_outdated(topic) for topic in bag.topics) and bag.counts["/cam0/detections"] == 2


def test_damage_within_a_chunk_names_the_remedy(tmp_path):
    path = write_mcap(tmp_path / "x.mcap", TOPICS, ROWS, Layout(compression="zstd", chunk=10))
    whole = bytearray(path.read_bytes())
    at = whole.find(b"\x28\xb5\x2f\xfd", whole.find(b"\x28\xb5\x2f\xfd") + 4)
    whole[at + 8 : at + 30] = bytes(22)
    path.write_bytes(whole)
    with BagReader(path) as bag, pytest.raises(DataError, match=r"is damaged: .*`panoptic bag repair"):
        list(bag.raw())
