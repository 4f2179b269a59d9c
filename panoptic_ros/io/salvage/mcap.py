"""MCAP files that end too early or are damaged: the whole records from the front.

A reader of our own, as those of libraries want the index at the end of the file, and that of MCAP's own
library which does not takes a record that was cut for a whole one (foxglove/mcap#1474).
Format: mcap.dev/spec.
"""
from __future__ import annotations

import io
import struct
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from rosbags.rosbag2.errors import ReaderError
from rosbags.rosbag2.metadata import parse_qos
from rosbags.rosbag2.storage_mcap import DECOMPRESSORS, decompress

from panoptic_ros.io.bag_connections import Connection
from panoptic_ros.io.salvage.found import Losses, Message

MAGIC = b"\x89MCAP0\r\n"
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, DATA_END = 0x02, 0x03, 0x04, 0x05, 0x06, 0x0F
_FRAME = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_CHUNK = struct.Struct("<QQQI")


class _Record(NamedTuple):
    kind: int
    content: bytes
    length: int  # as the record says; more than there is where it was cut

    @property
    def is_whole(self) -> bool:
        """Whether all of it is there, and it is one at all: there is none of kind 0."""
        return self.kind > 0 and len(self.content) == self.length


def mcap_messages(path: Path, losses: Losses, scratch: Path) -> Iterator[Message]:
    """The whole messages of a file, in the order in which they were written.

    Args:
        losses: is told what cannot be read. scratch: not needed.
    """
    with path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            losses.add(f"{path.name}: all of it, as it does not begin as MCAP does")
            return
        yield from _Contents(path.name, path.stat().st_size, losses).messages(file)


class _Contents:
    """Schemas and channels that were met so far."""

    def __init__(self, name: str, size: int, losses: Losses):
        self._name, self._size, self._losses = name, size, losses
        self._schemas: dict[int, tuple[str, str]] = {}
        self._channels: dict[int, Connection] = {}
        self._odd: set[tuple[str, str]] = set()  # topics, and words of QoS that are none

    def messages(self, file: BinaryIO) -> Iterator[Message]:
        while True:
            begin = file.tell()
            record = _next(file)
            if record is None or not record.is_whole:
                whole = begin
                if record is not None and record.kind == CHUNK:
                    whole += yield from self._of_cut_chunk(record)
                self._losses.add(f"{self._name}: the last {self._size - whole} of {self._size} bytes")
                return
            if record.kind in (DATA_END, FOOTER):
                self._check_end(file)
                return
            try:
                yield from self._of_chunk(record) if record.kind == CHUNK else self._of(record)
            except (ReaderError, ValueError, KeyError, struct.error, RuntimeError, EOFError) as error:
                why = " ".join(str(error).split())
                self._losses.add(f"{self._name}: {record.length} bytes at {begin}, which are damaged ({why})")

    def _check_end(self, file: BinaryIO) -> None:
        """Messages end before the index, which is made anew; without it nothing else opens the file."""
        file.seek(0, io.SEEK_END)
        file.seek(max(0, file.tell() - len(MAGIC)))
        if file.read() != MAGIC:
            self._losses.add(f"{self._name}: no message, but its index at the end")

    def _of_chunk(self, record: _Record) -> Iterator[Message]:
        _, _, size, crc, compression, packed = _chunk_of(record.content)
        content = decompress(packed, compression, size, crc)
        yield from self._inside(io.BytesIO(content))

    def _of_cut_chunk(self, record: _Record) -> Generator[Message, None, int]:
        """Whole messages at the front of a chunk that is not compressed; the bytes up to their end."""
        end = 0
        try:
            *_, compression, packed = _chunk_of(record.content)
            content = io.BytesIO(b"" if compression else packed)
            for message in self._inside(content):
                end = _FRAME.size + len(record.content) - len(packed) + content.tell()
                yield message
        except (ValueError, KeyError, struct.error):
            pass  # cut within its own header, or within a record: the caller tells what is lost
        return end

    def _inside(self, content: BinaryIO) -> Iterator[Message]:
        """The messages of a chunk.

        Raises:
            ValueError: where it ends within a record.
        """
        while (record := _next(content)) is not None and record.is_whole:
            yield from self._of(record)
        if record is not None:
            raise ValueError("its records are not whole")

    def _of(self, record: _Record) -> Iterator[Message]:
        """The message of a record, if it is one."""
        content = record.content
        if record.kind == SCHEMA:
            number, *words = _schema_of(content)
            self._schemas[int(number)] = (str(words[0]), str(words[1]))
        elif record.kind == CHANNEL:
            number, schema = struct.unpack_from("<HH", content)
            self._channels[number] = self._channel_of(content, *self._schemas[schema])
        elif record.kind == MESSAGE:
            channel, _, stamp, _ = _MESSAGE.unpack_from(content)
            yield Message(self._channels[channel], stamp, content[_MESSAGE.size :])

    def _channel_of(self, content: bytes, kind: str, definition: str) -> Connection:
        topic, at = _string(content, 4)
        _, at = _string(content, at)
        about, _ = _string(content, at)
        words: list[str] = []
        at = 0
        while at < len(about):
            word, at = _string(about, at)
            words.append(word.decode())
        told, name = dict(zip(words[::2], words[1::2])), topic.decode()
        qualities = self._qualities(name, told.get("offered_qos_profiles", ""))
        return Connection(name, kind, definition, told.get("topic_type_hash", ""), qualities)

    def _qualities(self, topic: str, text: str) -> tuple[Any, ...]:
        """The QoS that publishers offered; none, and told so, where its words are damaged."""
        try:
            return tuple(parse_qos(text)) if text else ()
        except Exception:  # rosbags trusts what it reads: damage shows as anything
            if (topic, text) not in self._odd:  # a channel is told of again with every chunk
                self._odd.add((topic, text))
                self._losses.add(
                    f"{self._name}: no message, but the QoS of {topic}; it is played with ROS's defaults now"
                )
            return ()


def _next(file: BinaryIO) -> _Record | None:
    """The next record; None at the end. Where there is less than the frame of one, it is not whole."""
    frame = file.read(_FRAME.size)
    if len(frame) < _FRAME.size:
        return _Record(0, frame, _FRAME.size) if frame else None
    kind, length = _FRAME.unpack(frame)
    return _Record(kind, _read_at_most(file, length), length)


def _read_at_most(file: BinaryIO, length: int) -> bytes:
    """As much as there is: a damaged length must not ask for more memory than the file has bytes."""
    here = file.tell()
    rest = file.seek(0, io.SEEK_END) - here
    file.seek(here)
    return file.read(min(length, rest))


def _string(content: bytes, at: int) -> tuple[bytes, int]:
    (length,) = struct.unpack_from("<I", content, at)
    end = at + 4 + length
    if end > len(content):
        raise ValueError(f"a string of {length} bytes, where there are {len(content) - at - 4}")
    return content[at + 4 : end], end


def _schema_of(content: bytes) -> tuple[int, str, str]:
    """Number, name, definition."""
    (number,) = struct.unpack_from("<H", content)
    name, at = _string(content, 2)
    _, at = _string(content, at)
    definition, _ = _string(content, at)
    return number, name.decode(), definition.decode()


def _chunk_of(content: bytes) -> tuple[int, int, int, int, str, bytes]:
    """First and last stamp, size and checksum of what was packed, how, and the packed bytes."""
    compression, at = _string(content, _CHUNK.size)
    if compression.decode() not in DECOMPRESSORS:
        raise ValueError(f"compression {compression!r} is not known")
    (length,) = struct.unpack_from("<Q", content, at)
    return (*_CHUNK.unpack_from(content), compression.decode(), content[at + 8 : at + 8 + length])
