"""Messages of several topics and bags in one order, whatever the stamps do."""

import struct

import captures
import pytest
from recordings import write_bag

from panoptic_ros.errors import DataError
from panoptic_ros.io.bag_streams import BagMessage, BagStream, merged
from panoptic_ros.io.bags import BagReader, BagWriter

SECOND = 1_000_000_000
STEP = 40_000_000
START = 7200 * SECOND


def messages(of, on_bad):
    """Without the ends of streams."""
    return [item for item in merged(of, on_bad) if isinstance(item, BagMessage)]


def streams(bag, cameras=("cam0", "cam1"), **more):
    return [BagStream(bag, f"/{name}/detections", name, "detections", **more) for name in cameras]


def rewritten(path, source, change):
    """A copy of a bag; `change(topic, number on the topic, bytes)` gives the bytes of a message."""
    numbers = {}
    with BagReader(source) as old, BagWriter(path) as new:
        for topic, stamp, data, kind in old.raw():
            number = numbers.setdefault(topic, 0)
            numbers[topic] += 1
            new.write_raw(topic, kind, stamp, change(topic, number, bytes(data)))
    return path


def with_stamp(data, stamp_ns):
    return data[:4] + struct.pack("<iI", *divmod(stamp_ns, SECOND)) + data[12:]


@pytest.fixture
def bag(tmp_path):
    views = [captures.view(c, i, START + i * STEP) for i in range(6) for c in captures.RIG.cameras]
    return write_bag(tmp_path / "bag", views)


def refuse(error):
    raise error


def test_order_of_stamps_over_topics(bag):
    rows = [(item.stamp_ns, item.stream.camera) for item in messages(streams(bag), refuse)]
    assert rows == [(START + i * STEP, name) for i in range(6) for name in ("cam0", "cam1")]


def test_several_bags(tmp_path):
    def part(name):
        views = [captures.view(captures.RIG.camera(name), i, i * STEP) for i in range(4)]
        return write_bag(tmp_path / name, views)

    rows = messages([*streams(part("cam0"), ["cam0"]), *streams(part("cam1"), ["cam1"])], refuse)
    assert [item.stream.camera for item in rows] == ["cam0", "cam1"] * 4


@pytest.mark.parametrize("jump_s", [-3600, 3600, -0.5])
def test_a_clock_that_jumps_keeps_its_place(tmp_path, bag, jump_s):
    """All messages of cam0 from the fourth on have other stamps, and still come beside those of cam1."""

    def change(topic, number, data):
        stamp = START + number * STEP + round(jump_s * SECOND)
        return with_stamp(data, stamp) if topic == "/cam0/detections" and number >= 3 else data

    jumping = rewritten(tmp_path / "jumping", bag, change)
    assert [item.stream.camera for item in messages(streams(jumping), refuse)] == ["cam0", "cam1"] * 6


def test_times_of_recording_in_place_of_stamps(tmp_path, bag):
    zero = rewritten(tmp_path / "zero", bag, lambda topic, number, data: with_stamp(data, 0))
    items = list(messages(streams(zero, arrival_stamps=True), refuse))
    assert [item.stamp_ns for item in items] == [START + i * STEP for i in range(6) for _ in range(2)]
    first = items[0]
    assert first.stream.record(first.message, 0).stamp_ns == START
    assert struct.unpack_from("<iI", first.data, 4) == divmod(START, SECOND)


def test_what_cannot_be_decoded_is_told_and_left_out(tmp_path, bag):
    def change(topic, number, data):
        spoilt = {1: data[:6], 2: data[:12] + b"\xff" * 40}
        return spoilt.get(number, data) if topic == "/cam0/detections" else data

    problems = []
    items = list(messages(streams(rewritten(tmp_path / "spoilt", bag, change)), problems.append))
    assert len(items) == 10 and len(problems) == 2
    assert all("/cam0/detections" in str(error) for error in problems)


def test_first_record_skips_a_few_bad_ones(tmp_path, bag):
    spoilt = rewritten(tmp_path / "b", bag, lambda topic, number, data: data[:6] if number < 2 else data)
    with BagReader(spoilt) as reader:
        assert streams(spoilt)[0].first_record(reader).stamp_ns == START + 2 * STEP
    useless = rewritten(tmp_path / "c", bag, lambda topic, number, data: data[:6])
    with BagReader(useless) as reader, pytest.raises(DataError, match="/cam0/detections"):
        streams(useless)[0].first_record(reader)
