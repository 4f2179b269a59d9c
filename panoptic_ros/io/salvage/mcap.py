"""MCAP files that end too early or are damaged: the whole records from the front.

A reader of our own, as those of libraries want the index at the end of the file, and that of MCAP's own
library which does not takes a record that was cut for a whole one (foxglove/mcap#1474).
"""

from __future__ import annotations

import io
import struct
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

from panoptic_ros.errors import one_line
from panoptic_ros.io.salvage.found import Losses, Message
from panoptic_ros.io.storages.records import (
    CHUNK,
    DATA_END,
    FOOTER,
    FRAME,
    MAGIC,
    MESSAGE,
    MESSAGE_HEAD,
    Topics,
    chunk_of,
    records_in,
)
from panoptic_ros.io.storages.storage import Foreign


class _Record(NamedTuple):
    kind: int
    content: bytes
    length: int  # as the record says; more than there is where it was cut

    @property
    def is_whole(self) -> bool:
        """Whether all of it is there, and it is one at all: there is none of kind 0."""
        return self.kind > 0 and len(self.content) == self.length


def mcap_messages(path: Path, losses: Losses, scratch: Path) -> Iterator[Message]:
    """Yield the whole messages of a file, in the order in which they were written.

    Args:
        losses: takes what cannot be read. scratch: not needed.
    """
    with path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            losses.add(f"{path.name}: all of it, as it does not begin as MCAP does")
            return
        yield from _Contents(path.name, path.stat().st_size, losses).messages(file)


class _Contents:
    """Topics of the records so far, and what they lost."""

    def __init__(self, name: str, size: int, losses: Losses):
        self._name, self._size, self._losses = name, size, losses
        self._topics = Topics(self._tell_quality)
        self._odd: set[tuple[str, str]] = set()  # topics, and words of QoS that cannot be read

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
                if record.kind == CHUNK:
                    yield from self._inside(chunk_of(record.content).content)
                elif (message := self._of(record.kind, record.content)) is not None:
                    yield message
            except Exception as error:  # libraries trust what they unpack: damage shows as anything
                damaged = f"{record.length} bytes at {begin}, which are damaged ({one_line(error)})"
                self._losses.add(f"{self._name}: {damaged}")

    def _check_end(self, file: BinaryIO) -> None:
        """Messages end before the index, which is made anew; without it nothing else opens the file."""
        file.seek(0, io.SEEK_END)
        file.seek(max(0, file.tell() - len(MAGIC)))
        if file.read() != MAGIC:
            self._losses.add(f"{self._name}: no message, but its index at the end")

    def _of_cut_chunk(self, record: _Record) -> Generator[Message, None, int]:
        """Whole messages at the front of a chunk that is not compressed; the bytes up to their end."""
        end = 0
        try:
            chunk = chunk_of(record.content)
            content = b"" if chunk.compression else chunk.packed
            before = FRAME.size + len(record.content) - len(chunk.packed)
            for kind, begin, record_end in records_in(content):
                message = self._of(kind, content[begin:record_end])
                if message is not None:
                    end = before + record_end
                    yield message
        except (ValueError, KeyError, struct.error):
            pass  # cut within its own header, or within a record: the caller tells what is lost
        return end

    def _inside(self, content: bytes) -> Iterator[Message]:
        """Yield the messages of a chunk. A damaged record costs only itself.

        Raises:
            ValueError: where it ends within a record.
        """
        for kind, begin, end in records_in(content):
            try:
                message = self._of(kind, content[begin:end])
            except (ValueError, KeyError, struct.error):
                self._losses.count(self._name, "records of topics, which are damaged")
                continue
            if message is not None:
                yield message

    def _of(self, kind: int, content: bytes) -> Message | None:
        """Return the message of a record, if it is one that can be written."""
        if kind != MESSAGE:
            self._topics.take(kind, content)
            return None
        channel, _, stamp, _ = MESSAGE_HEAD.unpack_from(content)
        if (other := self._topics.foreign.get(channel)) is not None:
            self._losses.count(self._name, left_out(other))
        elif (connection := self._topics.known.get(channel)) is not None:
            return Message(connection, stamp, content[MESSAGE_HEAD.size :])
        else:
            self._losses.count(self._name, "messages on topics of which nothing is known")
        return None

    def _tell_quality(self, topic: str, text: str) -> None:
        if (topic, text) not in self._odd:  # every chunk can repeat a channel
            self._odd.add((topic, text))
            self._losses.add(odd_quality(self._name, topic))


def left_out(other: Foreign) -> str:
    """Return the line about messages that are not of ROS 2."""
    return f"messages on {other.topic}, which are {other.what}"


def odd_quality(name: str, topic: str) -> str:
    """Return the line about words of QoS that cannot be read."""
    return f"{name}: no message, but the QoS of {topic}; it is played with ROS's defaults now"


def _next(file: BinaryIO) -> _Record | None:
    """The next record; None at the end. Where there is less than the frame of one, it is not whole."""
    frame = file.read(FRAME.size)
    if len(frame) < FRAME.size:
        return _Record(0, frame, FRAME.size) if frame else None
    kind, length = FRAME.unpack(frame)
    return _Record(kind, _read_at_most(file, length), length)


def _read_at_most(file: BinaryIO, length: int) -> bytes:
    """As much as there is: a damaged length must not ask for more memory than the file has bytes."""
    here = file.tell()
    rest = file.seek(0, io.SEEK_END) - here
    file.seek(here)
    return file.read(min(length, rest))
