"""Rosbags (rosbag2, MCAP) without ROS: writing records or raw messages, reading them back."""
from __future__ import annotations

import os
import shutil
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import Any

from rosbags.rosbag2 import Reader, StoragePlugin, Writer, WriterError

from panoptic_ros.errors import DataError
from panoptic_ros.io.bag_connections import Connection, digest_of
from panoptic_ros.io.documents import read_yaml
from panoptic_ros.io.files import file_errors
from panoptic_ros.io.loading import MIB
from panoptic_ros.io.messages.earlier import bringing_up
from panoptic_ros.io.messages.family import PACKAGE, bag_typestore, decode_cdr
from panoptic_ros.io.takes import sync_files

# of metadata.yaml, bytes and values; 480 cameras with eight topics each have 2 MB and 100 000
LARGEST_METADATA, MOST_VALUES = 16 * MIB, 1_000_000


class BagWriter:
    """Writes a bag as a whole: it appears under its name when it is closed without an error.

    Use as a context manager; after an exception nothing is left behind.

    Args:
        in_place: under its name from the beginning, without metadata.yaml until it is closed; what it has
            then stays, whatever happens, and `io.salvage` reads it. For what cannot be recorded again.

    Raises:
        DataError: if something of that name is there already.
        EnvironmentProblem: on a full disk or missing permission.
    """

    def __init__(self, path: Path, in_place: bool = False):
        self.path = Path(path)
        if os.path.lexists(self.path):  # a link to nothing too
            raise DataError(f"{self.path} is there already; choose another name or remove it")
        self._in_place = in_place
        self._part = self.path.with_name(f".{self.path.name}.{os.getpid()}.part")
        with file_errors(self.path, "write"):
            self.path.parent.mkdir(parents=True, exist_ok=True)
            if not in_place:
                shutil.rmtree(self._part, ignore_errors=True)
                self._part.mkdir()
            place = self.path if in_place else self._part / self.path.name
            self._writer = Writer(place, version=9, storage_plugin=StoragePlugin.MCAP)
            self._writer.open()
        self._connections: dict[str | Connection, Any] = {}
        self._open = True

    def write_raw(self, topic: str, message_type: str, stamp_ns: int, data: bytes) -> None:
        """Append a message as CDR bytes; `message_type` is "package/msg/Name"."""
        with file_errors(self.path, "write"):
            if topic not in self._connections:
                self._connections[topic] = self._writer.add_connection(
                    topic, message_type, typestore=bag_typestore()
                )
            self._writer.write(self._connections[topic], stamp_ns, data)

    def write_described(self, connection: Connection, stamp_ns: int, data: bytes) -> None:
        """Append a message as CDR bytes with the definition that another bag has of it."""
        with file_errors(self.path, "write"):
            if connection not in self._connections:
                self._connections[connection] = self._writer.add_connection(
                    connection.topic, connection.kind, msgdef=connection.definition,
                    rihs01=digest_of(connection), offered_qos_profiles=connection.qualities,
                )  # fmt: skip
            self._writer.write(self._connections[connection], stamp_ns, data)

    @property
    def folder(self) -> Path:
        """Where it is being written: for files that are needed meanwhile."""
        return self._part

    def write(self, topic: str, stamp_ns: int, message: Any) -> None:
        """Append a message of the family `bag_messages()`."""
        kind = message.__msgtype__
        self.write_raw(topic, kind, stamp_ns, bytes(bag_typestore().serialize_cdr(message, kind)))

    def close(self) -> None:
        """Finish: the bag gets its name."""
        if self._open:
            self._open = False
            with file_errors(self.path, "write"):
                self._writer.close()
                if self._in_place:
                    sync_files(self.path)
                else:
                    os.replace(self._part / self.path.name, self.path)
                    self._part.rmdir()

    def flush(self) -> None:
        """Write a chunk of all so far to the disk: a kill or a power cut costs what comes after."""
        storage: Any = self._writer.storage
        with file_errors(self.path, "write"):
            if storage.chunk.bio.tell():
                storage.close_chunk()
            storage.bio.flush()
            os.fsync(storage.bio.fileno())

    def discard(self) -> None:
        """Stop and leave nothing behind; in place, what was written stays."""
        if self._open:
            self._open = False
            with suppress(OSError, WriterError):
                self._writer.abort()
            if not self._in_place:
                shutil.rmtree(self._part, ignore_errors=True)

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self.close()
        else:
            self.discard()


class BagReader:
    """Reads a bag: the topics it has, and their messages in the order of recording.

    Iterations that `interleaves` allows side by side may be in threads of their own.

    Raises:
        DataError: if it is no bag, was never finished, or is damaged.
    """

    def __init__(self, path: Path):
        self.path = Path(path)
        if not self.path.exists():
            raise DataError(f"there is no bag {self.path}")
        self._reading = threading.Lock()
        self._reader = self._opened()
        self.topics: dict[str, str] = {c.topic: c.msgtype for c in self._reader.connections}
        self.counts: dict[str, int] = {
            name: info.msgcount for name, info in self._reader.topics.items()
        }
        self.length_s = self._reader.duration * 1e-9
        self.begin_ns, self.end_ns = self._reader.start_time, self._reader.end_time

    def _opened(self) -> Reader:
        self._check_metadata()
        try:
            reader = Reader(self.path)
            reader.open()
        except Exception as error:  # rosbags trusts a file's lengths and offsets: damage shows as anything
            raise DataError(
                f"{self.path} cannot be read as a rosbag2 ({_one_line(error)}); where a recording was "
                f"cut off, `panoptic bag repair {self.path}` saves what is whole"
            ) from None
        return reader

    def _check_metadata(self) -> None:
        """Check size and nesting of metadata.yaml, as the library takes minutes for large ones.

        Raises:
            DataError: if not.
        """
        path = self.path / "metadata.yaml"
        if path.is_file():
            try:
                read_yaml(path, LARGEST_METADATA, MOST_VALUES)
            except DataError as error:
                raise DataError(
                    f"{self.path} cannot be read as a rosbag2 ({_one_line(error)}); "
                    f"`panoptic bag repair {self.path}` makes it anew from the messages"
                ) from None

    @property
    def interleaves(self) -> bool:
        """Whether several iterations over messages may go on side by side: not in an MCAP without index."""
        storage: Any = self._reader.storage
        return all(getattr(part, "chunks", True) for part in getattr(storage, "storages", [storage]))

    def messages(self, *topics: str) -> Iterator[tuple[str, int, Any]]:
        """(topic, recording stamp ns, message), of some topics or of all.

        Raises:
            DataError: if a message cannot be read.
        """
        for topic, stamp, data, kind in self.raw(*topics):
            yield topic, stamp, self._decode(topic, data, kind)

    def first(self, *topics: str) -> Iterator[tuple[str, int, bytes, str]]:
        """The first message of these topics together, as `raw`; nothing if there is none."""
        if set(topics) & set(self.topics):
            yield from islice(self.raw(*topics), 1)

    def raw(
        self, *topics: str, begin_ns: int | None = None, end_ns: int | None = None,
        on_bad: Callable[[DataError], None] | None = None,
    ) -> Iterator[tuple[str, int, bytes, str]]:  # fmt: skip
        """(topic, recording stamp ns, CDR bytes, type), of recording stamps in [begin_ns, end_ns).

        Args:
            on_bad: told about every message of an older version that cannot be brought up to now, which is
                left out. None = such a message is an error.

        Raises:
            DataError: if the bag is damaged, or its messages of this project are of another version.
        """
        chosen = [c for c in self._reader.connections if not topics or c.topic in topics]
        if not chosen:
            return
        up = {c.topic: self._brought_up(c) for c in chosen}
        try:
            for connection, stamp, data in self._one_by_one(self._reader.messages(chosen, begin_ns, end_ns)):
                bring = up[connection.topic]
                try:
                    data = bring(data) if bring else data
                except Exception as error:  # bytes of another kind raise anything
                    bad = DataError(f"{self.path}, topic {connection.topic}: {_one_line(error)}")
                    if on_bad is None:
                        raise bad from None
                    on_bad(bad)
                    continue
                yield connection.topic, stamp, data, connection.msgtype
        except DataError:
            raise
        except Exception as error:  # as above
            raise DataError(f"{self.path} is damaged: {_one_line(error)}") from None

    def _one_by_one(self, rows: Iterator[Any]) -> Iterator[Any]:
        """The rows; where several threads read, one seeks and reads in the file at a time."""
        while True:
            with self._reading:
                row = next(rows, None)
            if row is None:
                return
            yield row

    def is_outdated(self, topic: str) -> bool:
        """Whether its messages are of this project, but of another version, as the hash in the bag tells."""
        store = bag_typestore()
        for c in self._reader.connections:
            if c.topic == topic and c.msgtype.startswith(f"{PACKAGE}/") and c.msgtype in store.types:
                return bool(c.digest) and c.digest != store.hash_rihs01(c.msgtype)
        return False

    def can_be_brought_up(self, topic: str) -> bool:
        """Whether messages of another version can be read as those of now."""
        connection = self.connection(topic)
        return bringing_up(connection.kind, connection.definition) is not None

    def connection(self, topic: str) -> Connection:
        """A topic with the definition that the bag keeps."""
        c = next(c for c in self._reader.connections if c.topic == topic)
        qualities = tuple(getattr(c.ext, "offered_qos_profiles", ()))
        return Connection(topic, c.msgtype, c.msgdef.data, c.digest, qualities)

    def _brought_up(self, connection: Any) -> Callable[[bytes], bytes] | None:
        """What brings messages of other versions up to now."""
        topic, kind = connection.topic, connection.msgtype
        if not self.is_outdated(topic):
            return None
        bring = bringing_up(kind, connection.msgdef.data)
        if bring is None:
            raise DataError(
                f"{self.path} was recorded by another version of this program, whose {kind.split('/')[-1]} "
                f"(topic {topic}) had other fields; read it with that version, or make the bag anew from the "
                "capture with `panoptic run`"
            )
        return bring

    def _decode(self, topic: str, data: bytes, kind: str) -> Any:
        try:
            return decode_cdr(data, kind)
        except DataError as error:
            raise DataError(f"{self.path}, topic {topic}: {error}") from None

    def close(self) -> None:
        """Close the files."""
        self._reader.close()

    def __enter__(self) -> BagReader:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
