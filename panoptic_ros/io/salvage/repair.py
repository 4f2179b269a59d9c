"""Repair a cut bag: copy all complete messages into a new bag that every reader can open.

From a cut or damaged MCAP file, all complete records before the damage are read. The MCAP reader is our own.
Library readers need the index at the end of the file. The one reader of MCAP's own library that does not need
it accepts a cut record as complete (foxglove/mcap#1474). From a cut or damaged SQLite3 file, all readable
messages are read.
"""

from __future__ import annotations

import io
import re
import shutil
import sqlite3
import struct
import tempfile
from collections import Counter
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, NamedTuple

from panoptic_ros.errors import DataError, one_line
from panoptic_ros.io.bag_connections import Connection
from panoptic_ros.io.bag_metadata import NAME, count_difference, files_in, read_metadata
from panoptic_ros.io.bags import BagWriter
from panoptic_ros.io.files import file_errors
from panoptic_ros.io.storages import is_storage, packed_name, unpack
from panoptic_ros.io.storages.opening import ROS_1_SUFFIX, of_ros_1, unpacked_message
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
from panoptic_ros.io.storages.sqlite import JOURNALS, topics_of
from panoptic_ros.io.storages.storage import ForeignTopic


@dataclass(frozen=True)
class RepairResult:
    """Result of a repair.

    Args:
        counts: saved messages by topic.
        lost: one line for each loss; empty = nothing was lost.
        begin_ns, end_ns: recording times of the first and the last message.
    """

    counts: dict[str, int]
    lost: tuple[str, ...]
    begin_ns: int
    end_ns: int


def repair(source: Path, target: Path) -> RepairResult:
    """Write the complete messages of a bag to a new one; the old one stays unchanged.

    Args:
        source: folder of a bag, with or without metadata.yaml, or one of its files.
        target: must not exist yet.

    Raises:
        DataError: if there are no bag files, or no message in them is complete.
    """
    counts: Counter[str] = Counter()
    losses, stamps = Losses(), [2**63, 0]
    files = files_of(source)
    with BagWriter(target) as bag:
        for path in files:
            with file_errors(path, "read"):
                for connection, stamp_ns, packed in _messages(path, losses, bag.folder):
                    if (data := _plain(packed)) is None:
                        losses.count(path.name, f"messages on {connection.topic}, which are not CDR")
                        continue
                    bag.write_described(connection, stamp_ns, data)
                    counts[connection.topic] += 1
                    stamps = [min(stamps[0], stamp_ns), max(stamps[1], stamp_ns)]
        lost = (*losses.lines, *_missing(source, files, counts, losses))
        if not counts:
            raise DataError(f"{source} has no whole message{': ' if lost else ''}{'; '.join(lost)}")
    return RepairResult(dict(counts), lost, *stamps)


def _messages(path: Path, losses: Losses, scratch: Path) -> Iterator[SalvagedMessage]:
    """Yield the complete messages of a file, compressed or not."""
    name = packed_name(path)
    if name == path.name:
        yield from READERS[path.suffix](path, losses, scratch)
        return
    with tempfile.TemporaryDirectory(prefix="panoptic-repair-", dir=scratch) as folder:
        whole = Path(folder, name)
        if problem := unpack(path, whole):
            losses.add(f"{path.name}: {problem}")
        yield from READERS[whole.suffix](whole, losses, scratch)


def _plain(data: bytes) -> bytes | None:
    """Return a message without message-level compression; None if it is not in CDR."""
    try:
        plain = unpacked_message(data)
    except ValueError:
        return None
    return plain if plain[:1] == b"\0" else None  # all CDR begins with a zero byte


def _missing(source: Path, files: list[Path], counts: Counter[str], losses: Losses) -> Iterator[str]:
    """Yield lines about missing files and message counts of metadata.yaml that no other loss explains."""
    try:
        metadata = read_metadata(source)
    except DataError:  # the metadata are not needed for a repair
        return
    there = {packed_name(path) for path in files}
    missing = [name for name in metadata.files if packed_name(Path(name)) not in there]
    yield from (f"{name}: the whole file, as {NAME} names it but it does not exist" for name in missing)
    difference = count_difference(metadata.counts, counts)
    if difference and not missing and not losses.lines:
        yield difference


def files_of(source: Path) -> list[Path]:
    """Return the files of a bag in the order of recording.

    Raises:
        DataError: if there are none.
    """
    if not source.exists():
        raise DataError(f"there is no bag {source}")
    found = [source] if source.is_file() and is_storage(source) else []
    if source.is_dir():
        found = sorted(files_in(source), key=_by_numbers)
    old = source if source.suffix == ROS_1_SUFFIX else next(source.glob(f"*{ROS_1_SUFFIX}"), None)
    if not found and old is not None and old.is_file():
        raise of_ros_1(old)
    if not found:
        raise DataError(f"{source} holds no file of a bag ({', '.join(READERS)}, packed with zstd or not)")
    return found


def _by_numbers(path: Path) -> list[tuple[int, str]]:
    """Return a sort key that compares numbers by value: bag_2 comes before bag_10."""
    words = re.split(r"(\d+)", path.name)
    return [(int(word), "") if word.isdigit() else (0, word) for word in words]


class SalvagedMessage(NamedTuple):
    """A complete message with its recording time (ns) and CDR bytes."""

    connection: Connection
    stamp_ns: int
    data: bytes


class Losses:
    """Losses of a bag, one line each; an intact bag has none."""

    def __init__(self) -> None:
        self._lines: list[str] = []
        self._counts: Counter[tuple[str, str]] = Counter()  # number of losses by file and kind of loss

    @property
    def lines(self) -> list[str]:
        """Return all lines; lines with numbers of losses come last."""
        return self._lines + [f"{name}: {count} {what}" for (name, what), count in self._counts.items()]

    def add(self, line: str) -> None:
        """Add a line."""
        self._lines.append(line)

    def count(self, name: str, what: str) -> None:
        """Count one more loss of a file."""
        self._counts[name, what] += 1


LONGEST_STEP = 2**40  # largest step in row numbers to search for readable rows after a damaged one


def sqlite_messages(path: Path, losses: Losses, scratch: Path) -> Iterator[SalvagedMessage]:
    """Yield the messages of an SQLite file in the order in which they were written.

    The function reads a copy of the file and its journal, because SQLite repairs a file when it opens it.

    Args:
        losses: receives the losses.
        scratch: folder for the copy.
    """
    with tempfile.TemporaryDirectory(prefix="panoptic-repair-", dir=scratch) as folder:
        copy = Path(folder, path.name)
        for suffix in ("", *JOURNALS):
            if (part := path.with_name(path.name + suffix)).exists():
                shutil.copyfile(part, copy.with_name(copy.name + suffix))
        _cut_to_pages(copy)
        base = sqlite3.connect(copy)
        try:
            # otherwise SQLite refuses a file that is shorter than its first page states
            base.execute("PRAGMA writable_schema=ON")
            yield from _rows_of(base, path.name, losses)
        except sqlite3.DatabaseError as error:
            losses.add(f"{path.name}: all of it ({error})")
        finally:
            base.close()


def _cut_to_pages(path: Path) -> None:
    """Cut an incomplete last page: SQLite would read its missing part as zeros."""
    with path.open("r+b") as file:
        size = int.from_bytes(file.read(18)[16:18], "big")
        page = 65536 if size == 1 else max(512, size)
        file.truncate(path.stat().st_size // page * page)


def _rows_of(base: sqlite3.Connection, name: str, losses: Losses) -> Iterator[SalvagedMessage]:
    topics = topics_of(base)
    for topic, _ in topics.odd:
        losses.add(odd_quality(name, topic))
    last, step, damaged = 0, 1, 0
    while step <= LONGEST_STEP:
        try:
            rows = base.execute(
                "SELECT id, topic_id, timestamp, data FROM messages WHERE id >= ? ORDER BY id", (last + step,)
            )
            for number, topic, stamp, data in rows:
                if number <= last:  # damaged pages can link back to earlier ones
                    raise sqlite3.DatabaseError("rows are not in order")
                if (other := topics.foreign.get(topic)) is not None:
                    losses.count(name, left_out(other))
                    last, step = number, 1
                    continue
                message = SalvagedMessage(topics.known[topic], int(stamp), bytes(data))
                last, step = number, 1
                yield message
            break
        except (sqlite3.DatabaseError, KeyError, TypeError, ValueError):
            damaged += step == 1
            step *= 2
    if damaged:
        losses.add(f"{name}: messages that are not whole, at {damaged} place{'s' if damaged > 1 else ''}")
    elif _is_damaged(base):
        losses.add(f"{name}: no message, but its index")


def _is_damaged(base: sqlite3.Connection) -> bool:
    try:
        return bool(base.execute("PRAGMA quick_check(1)").fetchone()[0] != "ok")
    except sqlite3.DatabaseError:
        return True


class _Record(NamedTuple):
    kind: int
    content: bytes
    length: int  # length that the record states; larger than the content of a cut record

    @property
    def is_whole(self) -> bool:
        """Return whether the record is complete and valid: kind 0 does not exist."""
        return self.kind > 0 and len(self.content) == self.length


def mcap_messages(path: Path, losses: Losses, scratch: Path) -> Iterator[SalvagedMessage]:
    """Yield the complete messages of an MCAP file, in the order in which they were written.

    Args:
        losses: receives the losses.
        scratch: not used.
    """
    with path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            losses.add(f"{path.name}: all of it, as it does not begin as MCAP does")
            return
        yield from _Contents(path.name, path.stat().st_size, losses).messages(file)


class _Contents:
    """Reader of the records of one damaged MCAP file; it keeps the topics read so far."""

    def __init__(self, name: str, size: int, losses: Losses):
        self._name, self._size, self._losses = name, size, losses
        self._topics = Topics(self._tell_quality)
        self._odd: set[tuple[str, str]] = set()  # (topic, QoS text) pairs that cannot be parsed

    def messages(self, file: BinaryIO) -> Iterator[SalvagedMessage]:
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
            # libraries do not validate what they decompress, so damage can raise any exception
            except Exception as error:
                damaged = f"{record.length} bytes at {begin}, which are damaged ({one_line(error)})"
                self._losses.add(f"{self._name}: {damaged}")

    def _check_end(self, file: BinaryIO) -> None:
        """Check the end of the file; without the closing magic, other readers refuse it.

        The messages end before the index, and the new bag gets a new index.
        """
        file.seek(0, io.SEEK_END)
        file.seek(max(0, file.tell() - len(MAGIC)))
        if file.read() != MAGIC:
            self._losses.add(f"{self._name}: no message, but its index at the end")

    def _of_cut_chunk(self, record: _Record) -> Generator[SalvagedMessage, None, int]:
        """Yield the complete messages of a cut, uncompressed chunk; return the bytes up to the last one."""
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
            pass  # cut inside a record or the chunk header; the caller reports the loss
        return end

    def _inside(self, content: bytes) -> Iterator[SalvagedMessage]:
        """Yield the messages of a chunk. A damaged record loses only itself.

        Raises:
            ValueError: if the chunk ends within a record.
        """
        for kind, begin, end in records_in(content):
            try:
                message = self._of(kind, content[begin:end])
            except (ValueError, KeyError, struct.error):
                self._losses.count(self._name, "records of topics, which are damaged")
                continue
            if message is not None:
                yield message

    def _of(self, kind: int, content: bytes) -> SalvagedMessage | None:
        """Return the message of a record; None if it is not a message that can be written."""
        if kind != MESSAGE:
            self._topics.take(kind, content)
            return None
        channel, _, stamp, _ = MESSAGE_HEAD.unpack_from(content)
        if (other := self._topics.foreign.get(channel)) is not None:
            self._losses.count(self._name, left_out(other))
        elif (connection := self._topics.known.get(channel)) is not None:
            return SalvagedMessage(connection, stamp, content[MESSAGE_HEAD.size :])
        else:
            self._losses.count(self._name, "messages on unknown topics")
        return None

    def _tell_quality(self, topic: str, text: str) -> None:
        if (topic, text) not in self._odd:  # every chunk may repeat a channel
            self._odd.add((topic, text))
            self._losses.add(odd_quality(self._name, topic))


def left_out(other: ForeignTopic) -> str:
    """Return the line about messages that are not ROS 2."""
    return f"messages on {other.topic}, which are {other.what}"


def odd_quality(name: str, topic: str) -> str:
    """Return the line about QoS profiles that cannot be parsed."""
    return f"{name}: no message, but the QoS of {topic}; it is played with ROS's defaults now"


def _next(file: BinaryIO) -> _Record | None:
    """Read the next record; None at the end.

    A remainder shorter than a record header gives an incomplete record.
    """
    frame = file.read(FRAME.size)
    if len(frame) < FRAME.size:
        return _Record(0, frame, FRAME.size) if frame else None
    kind, length = FRAME.unpack(frame)
    return _Record(kind, _read_at_most(file, length), length)


def _read_at_most(file: BinaryIO, length: int) -> bytes:
    """Read at most the rest of the file: a damaged length must not allocate more memory than that."""
    here = file.tell()
    rest = file.seek(0, io.SEEK_END) - here
    file.seek(here)
    return file.read(min(length, rest))


READERS: dict[str, Callable[[Path, Losses, Path], Iterator[SalvagedMessage]]] = {
    ".mcap": mcap_messages,
    ".db3": sqlite_messages,
}
