"""Read closed MCAP files.

The reader is our own because rosbags' reader skips chunks without a message index. That reader also refuses
profiles other than ros2, definitions in other languages and messages out of order, and compares no counts.
"""

from __future__ import annotations

import os
import struct
from array import array
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from panoptic_ros.errors import DataError
from panoptic_ros.io.storages.records import (
    CHANNEL,
    CHUNK,
    CHUNK_INDEX,
    DATA_END,
    FOOTER,
    FRAME,
    MAGIC,
    MESSAGE,
    MESSAGE_HEAD,
    SCHEMA,
    STATISTICS,
    Topics,
    chunk_of,
    records_in,
    string_in,
)
from panoptic_ros.io.storages.storage import NEVER_NS, Contents, MessageBatch, Row, merged

_FOOTER = struct.Struct("<QQI")  # start of the summary section, start of its offset section, checksum
_INDEX_HEAD = struct.Struct("<QQQQ")  # first and last recording time of a chunk, its offset and length
_INDEX_OF_ONE = 15  # bytes of a message index without entries; each entry has 16
_STATISTICS = struct.Struct("<QHIIIIQQ")


class _ChunkPosition(NamedTuple):
    """Position of a chunk in the file, with its time range (ns) and its number of messages by channel."""

    begin_ns: int
    end_ns: int
    offset: int
    length: int
    counts: Mapping[int, int]


class _StatedCounts(NamedTuple):
    """Numbers of messages, chunks, and messages by channel that the file states; the last may be missing."""

    messages: int
    chunks: int
    counts: Mapping[int, int]


class McapStorage:
    """Storage of an MCAP file, see `storage.Storage`.

    The file's index is used if it agrees with the file's statistics. Otherwise the whole file is read.

    Raises:
        DataError: if the file does not begin or end like MCAP.
        Exception: of any type, if it is damaged.
    """

    def __init__(self, path: Path):
        self._name = path.name
        self._file = path.open("rb")
        try:
            self._size = os.fstat(self._file.fileno()).st_size
            self._stated: _StatedCounts | None = None
            self._forget()
            summary = self._summary()
            if not self._take_index(summary):
                self._forget()
                self._read_through()
        except BaseException:
            self._file.close()
            raise
        self.contents = Contents(
            self._topics.known,
            self._topics.foreign,
            self._counts,
            self._begin_ns,
            self._end_ns,
            self._check_counts(),
        )

    def _forget(self) -> None:
        self._topics = Topics()
        self._places: list[_ChunkPosition] = []
        self._loose = _LooseMessages()
        self._counts: Counter[int] = Counter()
        self._begin_ns, self._end_ns = NEVER_NS, 0

    def messages(self, numbers: Collection[int], begin_ns: int, end_ns: int) -> Iterator[Row]:
        """Yield messages in the order of recording, see `storage.Storage`."""
        wanted = frozenset(numbers)
        parts = [
            MessageBatch(place.begin_ns, partial(self._of_chunk, place, wanted, begin_ns, end_ns))
            for place in self._places
            if place.begin_ns < end_ns and begin_ns <= place.end_ns and wanted & place.counts.keys()
        ]
        if len(self._loose):
            parts.append(
                MessageBatch(self._loose.begin_ns, partial(self._of_loose, wanted, begin_ns, end_ns))
            )
        return (row for _, row in merged(parts))

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _summary(self) -> bytes:
        """Return the records of the summary section; empty without one.

        Raises:
            DataError: if the file does not begin or end like MCAP.
        """
        if self._at(0, len(MAGIC)) != MAGIC:
            raise DataError(f"{self._name} does not begin as MCAP does")
        tail = FRAME.size + _FOOTER.size + len(MAGIC)
        data = self._at(max(0, self._size - tail), tail)
        if not data.endswith(MAGIC) or len(data) < tail or data[0] != FOOTER:
            raise DataError(f"{self._name} was not closed: its end is missing")
        begin, _, _ = _FOOTER.unpack_from(data, FRAME.size)
        end = self._size - tail
        return self._at(begin, end - begin) if 0 < begin < end else b""

    def _at(self, offset: int, length: int) -> bytes:
        self._file.seek(offset)
        return self._file.read(length)

    def _take_index(self, summary: bytes) -> bool:
        """Read the index; return whether it has all messages of the statistics and all their topics."""
        try:
            for kind, begin, end in records_in(summary):
                content = summary[begin:end]
                if kind == CHUNK_INDEX:
                    self._add(_place_of(content))
                elif kind == STATISTICS:
                    self._stated = _stated_in(content)
                else:
                    self._topics.take(kind, content)
        except Exception:  # damage can raise any exception; the messages before it may be intact
            return False
        told = self._stated
        return (
            told is not None
            and (told.messages, told.chunks) == (self._counts.total(), len(self._places))
            and (not told.counts or +Counter(told.counts) == +self._counts)
            and self._counts.keys() <= self._topics.known.keys() | self._topics.foreign.keys()
        )

    def _add(self, place: _ChunkPosition) -> None:
        self._places.append(place)
        self._counts.update(place.counts)
        if place.counts:
            self._begin_ns = min(self._begin_ns, place.begin_ns)
            self._end_ns = max(self._end_ns, place.end_ns)

    def _read_through(self) -> None:
        """Build the index by reading all records.

        Raises:
            Exception: of any type, if a record is damaged.
        """
        at = len(MAGIC)
        while True:
            kind, length = FRAME.unpack(self._at(at, FRAME.size))
            at += FRAME.size
            if kind in (DATA_END, FOOTER):
                break
            if at + length > self._size:
                raise ValueError("it ends within a record")
            if kind == CHUNK:
                self._add(self._indexed(at, length))
            elif kind == MESSAGE:
                channel, _, stamp, _ = MESSAGE_HEAD.unpack(self._at(at, MESSAGE_HEAD.size))
                self._loose.add(stamp, channel, at + MESSAGE_HEAD.size, length - MESSAGE_HEAD.size)
                self._counts[channel] += 1
            elif kind in (SCHEMA, CHANNEL):
                self._topics.take(kind, self._at(at, length))
            at += length
        if len(self._loose):
            self._begin_ns = min(self._begin_ns, self._loose.begin_ns)
            self._end_ns = max(self._end_ns, self._loose.end_ns)

    def _indexed(self, offset: int, length: int) -> _ChunkPosition:
        """Return the index entry of a chunk, after reading its schemas and channels."""
        content, stamps = chunk_of(self._at(offset, length)).content, []
        counts: Counter[int] = Counter()
        for kind, begin, end in records_in(content):
            if kind == MESSAGE:
                channel, _, stamp, _ = MESSAGE_HEAD.unpack_from(content, begin)
                counts[channel] += 1
                stamps.append(stamp)
            else:
                self._topics.take(kind, content[begin:end])
        return _ChunkPosition(min(stamps, default=NEVER_NS), max(stamps, default=0), offset, length, counts)

    def _check_counts(self) -> list[str]:
        stated, there, problems = self._stated, self._counts.total(), []
        if stated is not None and stated.messages != there:
            told = f"the statistics of {self._name} count {stated.messages} messages, it holds {there}"
            problems.append(told)
        described = self._topics.known.keys() | self._topics.foreign.keys()
        if lost := sum(count for channel, count in self._counts.items() if channel not in described):
            problems.append(f"{lost} messages of {self._name} are on unknown topics")
        return problems

    def _of_chunk(
        self, place: _ChunkPosition, wanted: Collection[int], begin_ns: int, end_ns: int
    ) -> Iterator[Row]:
        content, rows = chunk_of(self._at(place.offset, place.length)).content, []
        for kind, begin, end in records_in(content):
            if kind == MESSAGE:
                channel, _, stamp, _ = MESSAGE_HEAD.unpack_from(content, begin)
                if channel in wanted and begin_ns <= stamp < end_ns:
                    rows.append((stamp, channel, content[begin + MESSAGE_HEAD.size : end]))
        return iter(sorted(rows, key=lambda row: row[0]))

    def _of_loose(self, wanted: Collection[int], begin_ns: int, end_ns: int) -> Iterator[Row]:
        for stamp, channel, offset, length in self._loose.in_order():
            if channel in wanted and begin_ns <= stamp < end_ns:
                yield stamp, channel, self._at(offset, length)


class _LooseMessages:
    """Positions of messages outside of chunks, in the order of the file; 26 bytes each."""

    def __init__(self) -> None:
        self._stamps, self._offsets, self._lengths = array("q"), array("q"), array("q")
        self._channels = array("H")

    def __len__(self) -> int:
        return len(self._stamps)

    def add(self, stamp_ns: int, channel: int, offset: int, length: int) -> None:
        """Add a message."""
        self._stamps.append(stamp_ns)
        self._channels.append(channel)
        self._offsets.append(offset)
        self._lengths.append(length)

    @property
    def begin_ns(self) -> int:
        """Return the first recording time, ns."""
        return min(self._stamps)

    @property
    def end_ns(self) -> int:
        """Return the last recording time, ns."""
        return max(self._stamps)

    def in_order(self) -> Iterator[tuple[int, int, int, int]]:
        """Yield (recording time, channel, offset, length) of each message in the order of time."""
        for k in np.argsort(np.frombuffer(self._stamps, np.int64), kind="stable"):
            yield self._stamps[k], self._channels[k], self._offsets[k], self._lengths[k]


def _place_of(content: bytes) -> _ChunkPosition:
    """Return a chunk's entry from its index record; the lengths of the message indexes give the counts."""
    begin_ns, end_ns, offset, length = _INDEX_HEAD.unpack_from(content)
    packed, at = string_in(content, _INDEX_HEAD.size)
    (index_length,) = struct.unpack_from("<Q", content, at)
    begins = sorted((begin, channel) for channel, begin in struct.iter_unpack("<HQ", packed))
    ends = [begin for begin, _ in begins[1:]] + [offset + length + index_length]
    counts = {
        channel: (end - begin - _INDEX_OF_ONE) // 16
        for (begin, channel), end in zip(begins, ends)
        if end - begin > _INDEX_OF_ONE
    }
    return _ChunkPosition(begin_ns, end_ns, offset + FRAME.size, length - FRAME.size, counts)


def _stated_in(content: bytes) -> _StatedCounts:
    count, _, _, _, _, chunks, _, _ = _STATISTICS.unpack_from(content)
    (length,) = struct.unpack_from("<I", content, _STATISTICS.size)
    begin = _STATISTICS.size + 4
    return _StatedCounts(count, chunks, dict(struct.iter_unpack("<HQ", content[begin : begin + length])))
