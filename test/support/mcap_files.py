"""MCAP files as programs other than ours write them: with parts left out, or with what is not ROS 2."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from backports import zstd

from panoptic_ros.io.messages.family import bag_typestore

MAGIC = b"\x89MCAP0\r\n"
TEXT = "std_msgs/msg/String"


@dataclass(frozen=True)
class Channel:
    """A topic, its serialization, and its schema with the language of that; no schema where kind is empty."""

    topic: str
    message: str = "cdr"
    kind: str = TEXT
    language: str = "ros2msg"
    definition: str = "string data"
    about: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class Layout:
    """Parts that a writer leaves out or writes otherwise."""

    profile: str = "ros2"
    compression: str = ""
    chunk: int = 4  # messages in each; 0 = none are in chunks
    message_index: bool = True
    chunk_index: bool = True
    repeated: bool = True  # schemas and channels in the summary
    statistics: bool = True
    summary: bool = True
    stated: int = 0  # messages that the statistics count in excess


def text(words: str) -> bytes:
    """CDR bytes of a text."""
    store = bag_typestore()
    return bytes(store.serialize_cdr(store.types[TEXT](data=words), TEXT))


def write_mcap(
    path: Path, channels: Sequence[Channel], rows: Sequence[tuple[int, int, bytes]], layout: Layout = Layout()
) -> Path:
    """Write a file of rows (number of the channel, stamp ns, bytes)."""
    data = bytearray(MAGIC + _record(0x01, _string(layout.profile) + _string("test")))
    schemas = b"".join(
        _record(0x03, struct.pack("<H", k + 1) + b"".join(map(_string, (c.kind, c.language, c.definition))))
        for k, c in enumerate(channels)
        if c.kind
    )
    described = schemas + b"".join(_channel(k, channel) for k, channel in enumerate(channels))
    chunks, begun = [], bytearray(described)
    for first in range(0, len(rows), layout.chunk or len(rows)):
        part = rows[first : first + layout.chunk] if layout.chunk else rows
        places, content = [], bytes(begun) if layout.chunk else b""
        for channel, stamp, message in part:
            places.append((channel, stamp, len(content)))
            content += _record(0x05, struct.pack("<HIQQ", channel, 0, stamp, stamp) + message)
        if not layout.chunk:
            data += bytes(begun) + content
            break
        begun = bytearray()
        chunks.append(_add_chunk(data, content, places, layout))
    data += _record(0x0F, bytes(4))
    summary = len(data)
    if layout.summary:
        data += described if layout.repeated else b""
        data += b"".join(_record(0x08, chunk) for chunk in chunks) if layout.chunk_index else b""
        if layout.statistics:
            counts = Counter(channel for channel, _, _ in rows)
            table = b"".join(struct.pack("<HQ", *row) for row in counts.items())
            stamps = [stamp for _, stamp, _ in rows] or [0]
            head = struct.pack(
                "<QHIIIIQQ",
                len(rows) + layout.stated,
                1,
                len(channels),
                0,
                0,
                len(chunks),
                min(stamps),
                max(stamps),
            )
            data += _record(0x0B, head + struct.pack("<I", len(table)) + table)
    has_summary = len(data) > summary
    data += _record(0x02, struct.pack("<QQI", summary if has_summary else 0, 0, 0)) + MAGIC
    path.write_bytes(data)
    return path


def _add_chunk(
    data: bytearray, content: bytes, places: Sequence[tuple[int, int, int]], layout: Layout
) -> bytes:
    """Append a chunk and the index of its messages; return the record of its own index."""
    stamps = [stamp for _, stamp, _ in places]
    packed = zstd.compress(content) if layout.compression else content
    begin = len(data)
    head = struct.pack("<QQQI", min(stamps), max(stamps), len(content), 0)
    data += _record(0x06, head + _string(layout.compression) + struct.pack("<Q", len(packed)) + packed)
    end, offsets = len(data), []
    for channel in {channel: None for channel, _, _ in places} if layout.message_index else ():
        offsets.append((channel, len(data)))
        own = b"".join(struct.pack("<QQ", stamp, at) for number, stamp, at in places if number == channel)
        data += _record(0x07, struct.pack("<HI", channel, len(own)) + own)
    table = b"".join(struct.pack("<HQ", *row) for row in offsets)
    return (
        struct.pack("<QQQQI", min(stamps), max(stamps), begin, end - begin, len(table))
        + table
        + struct.pack("<Q", len(data) - end)
        + _string(layout.compression)
        + struct.pack("<QQ", len(packed), len(content))
    )


def _channel(number: int, channel: Channel) -> bytes:
    about = b"".join(_string(word) for pair in channel.about for word in pair)
    head = struct.pack("<HH", number, number + 1 if channel.kind else 0)
    table = struct.pack("<I", len(about)) + about
    return _record(0x04, head + _string(channel.topic) + _string(channel.message) + table)


def _record(kind: int, content: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(content)) + content


def _string(words: str) -> bytes:
    return struct.pack("<I", len(words.encode())) + words.encode()
