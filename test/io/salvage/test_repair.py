"""Bags that were cut anywhere come back with all that is whole, and open everywhere."""

import shutil
import signal
import sqlite3
import subprocess
import sys

import captures
import numpy as np
import pytest
import yaml
from backports import zstd
from mcap_files import Channel, Layout, text, write_mcap
from recordings import write_bag
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer

from panoptic_ros.errors import DataError
from panoptic_ros.io.bags import BagReader, BagWriter
from panoptic_ros.io.definitions import described
from panoptic_ros.io.messages.family import bag_typestore
from panoptic_ros.io.salvage import repair
from panoptic_ros.io.salvage.repair import Losses, mcap_messages

KIND = "std_msgs/msg/String"
COUNT = 60


def text_bag(path, plugin=StoragePlugin.MCAP, mode=CompressionMode.NONE, size=40):
    """A bag with numbered messages on two topics; gives what is in it."""
    store = bag_typestore()
    writer = Writer(path, version=9, storage_plugin=plugin)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    expected = []
    with writer:
        made = {topic: writer.add_connection(topic, KIND, typestore=store) for topic in ("/a", "/b")}
        for k in range(COUNT):
            topic = "/a" if k % 3 else "/b"
            text = f"{k} " + "".join(chr(97 + (k * j) % 26) for j in range(size))
            data = bytes(store.serialize_cdr(store.types[KIND](data=text), KIND))
            writer.write(made[topic], 1000 + k, data)
            expected.append((topic, 1000 + k, data))
    return expected


def only_file(path):
    return next(p for p in path.iterdir() if p.name != "metadata.yaml")


def content(path):
    """As rosbags itself reads it."""
    with Reader(path) as bag:
        return [(c.topic, stamp, bytes(data)) for c, stamp, data in bag.messages()]


def found_in(path, tmp_path):
    losses = Losses()
    return [(c.topic, stamp, data) for c, stamp, data in mcap_messages(path, losses, tmp_path)], losses.lines


@pytest.mark.parametrize("mode", [CompressionMode.NONE, CompressionMode.STORAGE])
def test_a_file_cut_at_every_position_gives_its_whole_messages(tmp_path, mode):
    expected = text_bag(tmp_path / "bag", mode=mode)
    path = only_file(tmp_path / "bag")
    whole = path.read_bytes()
    assert found_in(path, tmp_path) == (expected, [])
    counts = []
    cut = tmp_path / "cut.mcap"
    for size in range(0, len(whole), 7):
        cut.write_bytes(whole[:size])
        found, lost = found_in(cut, tmp_path)
        assert found == expected[: len(found)] and len(lost) == 1
        counts.append(len(found))
    assert counts == sorted(counts)
    if mode == CompressionMode.NONE:  # at most the message that was cut is lost
        assert "the last 0 of" not in lost[0]
        ends = [whole.find(data) + len(data) for _, _, data in expected]
        assert counts == [sum(end <= size for end in ends) for size in range(0, len(whole), 7)]
    else:
        assert set(counts) == {0, COUNT}


@pytest.mark.parametrize("plugin", list(StoragePlugin))
def test_a_cut_bag_opens_again(tmp_path, plugin):
    expected = text_bag(tmp_path / "bag", plugin, size=900)
    path = only_file(tmp_path / "bag")
    whole = path.read_bytes()
    (tmp_path / "bag" / "metadata.yaml").unlink()
    rng = np.random.default_rng(3)
    saved = []
    for k, size in enumerate(sorted(rng.integers(0, len(whole), 25))):
        path.write_bytes(whole[:size])
        try:
            made = repair(tmp_path / "bag", tmp_path / f"new{k}")
        except DataError as error:
            assert "no whole message" in str(error) and "\n" not in str(error)
            saved.append(0)
            continue
        back = content(tmp_path / f"new{k}")
        assert made.lost and back == [row for row in expected if row in back]
        assert sum(made.counts.values()) == len(back)
        saved.append(len(back))
    assert max(saved) > 0.7 * COUNT and not list(tmp_path.glob(".*")) and path.read_bytes() == whole[:size]


@pytest.mark.parametrize("plugin", list(StoragePlugin))
def test_a_whole_bag_without_metadata_loses_nothing(tmp_path, plugin):
    expected = text_bag(tmp_path / "bag", plugin)
    (tmp_path / "bag" / "metadata.yaml").unlink()
    made = repair(tmp_path / "bag", tmp_path / "new")
    assert made.lost == () and content(tmp_path / "new") == expected
    assert (made.begin_ns, made.end_ns) == (1000, 1000 + COUNT - 1)


def test_files_of_a_split_bag_follow_each_other(tmp_path):
    rows = {number: text_bag(tmp_path / f"bag_{number}") for number in (2, 10)}
    (tmp_path / "split").mkdir()
    for number in rows:
        shutil.move(only_file(tmp_path / f"bag_{number}"), tmp_path / "split" / f"bag_{number}.mcap")
    repair(tmp_path / "split", tmp_path / "new")
    assert len(content(tmp_path / "new")) == 2 * COUNT


def test_messages_that_were_compressed_one_by_one(tmp_path):
    expected = text_bag(tmp_path / "bag", mode=CompressionMode.MESSAGE)
    (tmp_path / "bag" / "metadata.yaml").unlink()
    repair(tmp_path / "bag", tmp_path / "new")
    assert content(tmp_path / "new") == expected


def test_damage_in_the_middle_costs_what_is_damaged(tmp_path):
    expected = text_bag(tmp_path / "bag", size=60_000)  # some chunks
    path = only_file(tmp_path / "bag")
    whole = bytearray(path.read_bytes())
    at = whole.find(expected[20][2])
    whole[at - 40 : at] = bytes(40)  # the frame of a message within a chunk
    path.write_bytes(whole)
    made = repair(tmp_path / "bag", tmp_path / "new")
    back = content(tmp_path / "new")
    assert COUNT // 2 < len(back) < COUNT and back[-1] == expected[-1] and len(made.lost) == 1


def test_random_damage_never_leaves_a_broken_bag(tmp_path):
    write_bag(tmp_path / "bag", captures.views(10))
    path = only_file(tmp_path / "bag")
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    opened = 0
    for k in range(40):
        changed = np.frombuffer(whole, np.uint8).copy()
        changed[rng.integers(0, len(whole), 1 + k // 4)] = rng.integers(0, 256, 1 + k // 4)
        path.write_bytes(changed.tobytes())
        try:
            repair(tmp_path / "bag", tmp_path / f"new{k}")
        except DataError as error:
            assert "\n" not in str(error)
            continue
        assert content(tmp_path / f"new{k}")
        opened += 1
    assert opened > 20 and not list(tmp_path.glob(".*"))


def test_what_is_no_bag_is_told(tmp_path):
    with pytest.raises(DataError, match="there is no bag"):
        repair(tmp_path / "no", tmp_path / "new")
    with pytest.raises(DataError, match="holds no file of a bag"):
        repair(tmp_path, tmp_path / "new")
    (tmp_path / "x.mcap").write_bytes(b"nothing of the kind")
    (tmp_path / "y.db3").write_bytes(b"nothing of the kind")
    with pytest.raises(DataError, match=r"no whole message: x.mcap: all of it.*; y.db3: all of it"):
        repair(tmp_path, tmp_path / "new")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["x.mcap", "y.db3"]


def test_a_killed_writer_of_sqlite_leaves_what_it_had_stored(tmp_path):
    program = f"""
import sqlite3, time
base = sqlite3.connect({str(tmp_path / "cut.db3")!r})
base.execute("PRAGMA journal_mode=WAL")
base.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)")
base.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)")
base.execute("INSERT INTO topics VALUES (1, '/a', {KIND!r}, 'cdr')")
for k in range(5):
    row = (k, bytes([0, 1, 0, 0, k]))
    base.execute("INSERT INTO messages (topic_id, timestamp, data) VALUES (1, ?, ?)", row)
    base.commit()
base.execute("INSERT INTO messages (topic_id, timestamp, data) VALUES (1, 9, x'00010000')")
print("ready", flush=True)
time.sleep(60)
"""
    child = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE)
    assert child.stdout.readline() == b"ready\n"
    child.send_signal(signal.SIGKILL)
    child.wait()
    made = repair(tmp_path / "cut.db3", tmp_path / "new")
    assert made.counts == {"/a": 5} and made.lost == ()
    with BagReader(tmp_path / "new") as bag:
        assert [stamp for _, stamp, _, _ in bag.raw()] == [0, 1, 2, 3, 4]


def test_damaged_words_of_qos_are_told_once_and_cost_no_message(tmp_path):
    store, connection = bag_typestore(), described("/a", KIND).offered(True, True)
    data = bytes(store.serialize_cdr(store.types[KIND](data="text"), KIND))
    bag = BagWriter(tmp_path / "bag", in_place=True)
    for k in range(5):
        bag.write_described(connection, k, data)
    bag.close()
    path = only_file(tmp_path / "bag")
    whole = path.read_bytes()
    assert found_in(path, tmp_path)[1] == [] and b"reliability: " in whole
    path.write_bytes(whole.replace(b"reliability: ", b"reliab\xc3\xa9lity "))
    found, lines = found_in(path, tmp_path)
    assert found == [("/a", k, data) for k in range(5)]
    assert len([line for line in lines if "the QoS of /a" in line]) == 1


ROWS = [(k % 2, 100 + k, text(f"message {k} " + "x" * 200)) for k in range(30)]
TOPICS = [Channel("/a"), Channel("/b")]


@pytest.mark.parametrize("compression", ["zstd", ""])
def test_a_damaged_chunk_costs_itself_alone(tmp_path, compression):
    path = write_mcap(tmp_path / "x.mcap", TOPICS, ROWS, Layout(compression=compression, chunk=10))
    whole, mark = bytearray(path.read_bytes()), zstd.compress(b"")[:4] if compression else b"message 10"
    at = whole.find(mark, whole.find(mark) + 4) if compression else whole.find(mark) - 60
    whole[at + 8 : at + 40] = bytes(32)
    path.write_bytes(whole)
    made = repair(path, tmp_path / "new")
    assert [row[1] for row in content(tmp_path / "new")] == [*range(100, 110), *range(120, 130)]
    assert len(made.lost) == 1 and "which are damaged" in made.lost[0] and "\n" not in made.lost[0]


def test_messages_that_are_no_cdr_are_left_out_and_counted(tmp_path):
    topics = [
        *TOPICS,
        Channel("/json", "json", "Thing", "jsonschema", "{}"),
        Channel("/bare", kind=""),
        Channel("/proto", "protobuf", "foxglove.Thing", "protobuf"),
        Channel("/one", "ros1", "a/B", "ros1msg"),
        Channel("/false"),
    ]
    rows = [*ROWS, *((2 + k % 5, 300 + k, b'{"a": 1}') for k in range(20))]
    made = repair(write_mcap(tmp_path / "x.mcap", topics, rows), tmp_path / "new")
    assert made.counts == {"/a": 15, "/b": 15} and len(content(tmp_path / "new")) == 30
    told = (
        "/json, which are JSON",
        "/bare, which are CDR of no stated type",
        "/proto, which are protobuf",
        "/one, which are ROS 1",
        "/false, which are not CDR",
    )
    assert sorted(made.lost) == sorted(f"x.mcap: 4 messages on {words}" for words in told)


def test_a_serialization_that_sqlite_states_and_words_that_are_no_qos(tmp_path):
    text_bag(tmp_path / "bag", StoragePlugin.SQLITE3)
    base = sqlite3.connect(only_file(tmp_path / "bag"))
    base.execute("UPDATE topics SET serialization_format = 'json' WHERE name = '/b'")
    base.execute("UPDATE topics SET offered_qos_profiles = 'no: [qos'")
    base.commit()
    base.close()
    made = repair(tmp_path / "bag", tmp_path / "new")
    assert made.counts == {"/a": 40} and {row[0] for row in content(tmp_path / "new")} == {"/a"}
    assert "the QoS of /a" in made.lost[0] and "20 messages on /b, which are JSON" in made.lost[1]


@pytest.mark.parametrize("damage", ["cut", "spoilt"])
def test_a_packed_file_gives_its_front(tmp_path, damage):
    expected = text_bag(tmp_path / "bag", size=9000)
    (tmp_path / "bag" / "metadata.yaml").unlink()
    path = only_file(tmp_path / "bag")
    packed = bytearray(zstd.compress(path.read_bytes()))
    path.unlink()
    at = 3 * len(packed) // 4
    packed[at:] = b"" if damage == "cut" else b"\xff" * (len(packed) - at)
    (tmp_path / "bag" / f"{path.name}.zstd").write_bytes(packed)
    made = repair(tmp_path / "bag", tmp_path / "new")
    back = content(tmp_path / "new")
    assert back == expected[: len(back)] and len(back) > COUNT // 4
    assert ("it was cut" if damage == "cut" else "it is damaged") in made.lost[0]


def test_a_packed_message_that_is_damaged_costs_itself_alone(tmp_path):
    rows = [(0, k, zstd.compress(text(f"message {k}"))) for k in range(5)]
    rows[2] = (0, 2, rows[2][2][:4] + b"\xff" * 9)
    made = repair(write_mcap(tmp_path / "x.mcap", TOPICS[:1], rows), tmp_path / "new")
    assert [row[1] for row in content(tmp_path / "new")] == [0, 1, 3, 4]
    assert made.lost == ("x.mcap: 1 messages on /a, which are not CDR",)


def test_what_the_metadata_tell_of_and_is_not_there_is_told(tmp_path):
    text_bag(tmp_path / "bag")
    path = tmp_path / "bag" / "metadata.yaml"
    document = yaml.safe_load(path.read_text())
    about = document["rosbag2_bagfile_information"]
    about["topics_with_message_count"][0]["message_count"] += 7
    path.write_text(yaml.safe_dump(document))
    made = repair(tmp_path / "bag", tmp_path / "new")
    assert made.lost == ("metadata.yaml counts 67 messages, there are 60: /a 40 of 47",)
    about["relative_file_paths"].append("bag_1.mcap")
    path.write_text(yaml.safe_dump(document))
    made = repair(tmp_path / "bag", tmp_path / "new2")
    assert made.lost == ("bag_1.mcap: the whole file, as metadata.yaml names it but it does not exist",)


def test_channels_of_one_topic_that_differ_go_into_one(tmp_path):
    digests = (("topic_type_hash", "RIHS01_" + 64 * digit) for digit in "12")
    topics = [Channel("/a", about=(digest,)) for digest in digests]
    made = repair(write_mcap(tmp_path / "x.mcap", topics, ROWS), tmp_path / "new")
    assert made.counts == {"/a": 30} and made.lost == () and len(content(tmp_path / "new")) == 30


def test_a_bag_of_ros_1_names_the_remedy(tmp_path):
    (tmp_path / "take.bag").write_bytes(b"#ROSBAG V2.0\n")
    for source in (tmp_path, tmp_path / "take.bag"):
        with pytest.raises(DataError, match="take.bag is a bag of ROS 1; .*rosbags-convert"):
            repair(source, tmp_path / "new")
