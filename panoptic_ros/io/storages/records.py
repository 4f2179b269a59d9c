"""Parse records of MCAP files (mcap.dev/spec), and the topics that their schemas and channels describe."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from typing import NamedTuple

from rosbags.rosbag2.storage_mcap import DECOMPRESSORS, decompress

from panoptic_ros.io.bag_connections import IDL, Connection, full_kind, qualities_of, serialization_but_cdr
from panoptic_ros.io.storages.storage import ForeignTopic

MAGIC = b"\x89MCAP0\r\n"
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, CHUNK_INDEX = 0x02, 0x03, 0x04, 0x05, 0x06, 0x08
STATISTICS, DATA_END = 0x0B, 0x0F
FRAME = struct.Struct("<BQ")  # type and length of a record
MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence number, recording time, publication time
_CHUNK_HEAD = struct.Struct("<QQQI")


class Chunk(NamedTuple):
    """Chunk record: first and last recording time (ns), size and checksum of the uncompressed data."""

    begin_ns: int
    end_ns: int
    size: int
    checksum: int
    compression: str
    packed: bytes

    @property
    def content(self) -> bytes:
        """Decompress the chunk and return the bytes of its records.

        Raises:
            Exception: of any type, if it is damaged.
        """
        return decompress(self.packed, self.compression, self.size, self.checksum)


def chunk_of(content: bytes) -> Chunk:
    """Return the chunk of a record; for a cut record, the part that exists.

    Raises:
        ValueError, struct.error: if it is not a chunk, or its compression is not supported.
    """
    compression, at = string_in(content, _CHUNK_HEAD.size)
    if compression.decode() not in DECOMPRESSORS:
        raise ValueError(f"compression {compression!r} is not known")
    (length,) = struct.unpack_from("<Q", content, at)
    begin, end, size, checksum = _CHUNK_HEAD.unpack_from(content)
    return Chunk(begin, end, size, checksum, compression.decode(), content[at + 8 : at + 8 + length])


def records_in(content: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield type, begin and end of each record.

    Raises:
        ValueError: if the content ends within a record.
    """
    at = 0
    while at < len(content):
        kind, length = FRAME.unpack_from(content, at) if at + FRAME.size <= len(content) else (0, 0)
        at += FRAME.size
        if not kind or at + length > len(content):  # record type 0 does not exist
            raise ValueError("its records are not whole")
        yield kind, at, at + length
        at += length


def string_in(content: bytes, at: int) -> tuple[bytes, int]:
    """Return the bytes of a string and its end position.

    Raises:
        ValueError, struct.error: if the string ends beyond the content.
    """
    (length,) = struct.unpack_from("<I", content, at)
    end = at + 4 + length
    if end > len(content):
        raise ValueError(f"a string of {length} bytes, where there are {len(content) - at - 4}")
    return content[at + 4 : end], end


class Topics:
    """Topics that the schemas and channels read so far describe.

    Args:
        on_odd_quality: called with a topic and its QoS text if that cannot be parsed.
    """

    def __init__(self, on_odd_quality: Callable[[str, str], None] = lambda topic, text: None):
        self.known: dict[int, Connection] = {}
        self.foreign: dict[int, ForeignTopic] = {}
        self._schemas: dict[int, tuple[str, str, str]] = {0: ("", "", "")}  # schema 0 means: no schema
        self._on_odd_quality = on_odd_quality

    def take(self, kind: int, content: bytes) -> None:
        """Read a record; types other than schema and channel are ignored.

        Raises:
            ValueError, KeyError, struct.error: if it is damaged, or its schema is missing.
        """
        if kind == SCHEMA:
            (number,) = struct.unpack_from("<H", content)
            name, at = string_in(content, 2)
            language, at = string_in(content, at)
            definition, _ = string_in(content, at)
            if number:
                text = definition.decode("utf-8", "replace")
                self._schemas[number] = full_kind(name.decode()), language.decode(), text
        elif kind == CHANNEL:
            self._take_channel(content)

    def _take_channel(self, content: bytes) -> None:
        number, schema = struct.unpack_from("<HH", content)
        topic, at = string_in(content, 4)
        serialization, at = string_in(content, at)
        about, _ = string_in(content, at)
        kind, language, definition = self._schemas[schema]
        name = topic.decode()
        what = serialization_but_cdr(serialization.decode("utf-8", "replace"), language, kind)
        if what:
            self.foreign[number] = ForeignTopic(name, what)
            return
        if language.endswith("idl") and not definition.startswith(IDL):
            definition = f"{IDL}{kind}\n{definition}"
        told = _table_in(about)
        self.known[number] = Connection(
            name,
            kind,
            definition,
            told.get("topic_type_hash", ""),
            self._qualities(name, told.get("offered_qos_profiles", "")),
        )

    def _qualities(self, topic: str, text: str) -> tuple[object, ...]:
        try:
            return qualities_of(text)
        except ValueError:
            self._on_odd_quality(topic, text)
            return ()


def _table_in(content: bytes) -> dict[str, str]:
    """Return a string-to-string map."""
    words: list[str] = []
    at = 0
    while at < len(content):
        word, at = string_in(content, at)
        words.append(word.decode("utf-8", "replace"))
    return dict(zip(words[::2], words[1::2]))
