"""Write and read rosbags (rosbag2, MCAP) without ROS, as records or as raw messages.

`upgrade` rewrites a bag of an earlier version with the message types of the current version.
"""

from __future__ import annotations

import os
import shutil
import threading
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import Any

from rosbags.rosbag2 import StoragePlugin, Writer, WriterError

from panoptic_ros.errors import DataError, EnvironmentProblem, one_line
from panoptic_ros.io.bag_connections import UNKNOWN_DIGEST, Connection, digest_of, qualities_in
from panoptic_ros.io.bag_metadata import NAME, BagMetadata, chosen_files, count_difference, read_metadata
from panoptic_ros.io.files import file_errors
from panoptic_ros.io.messages.earlier import bringing_up
from panoptic_ros.io.messages.family import PACKAGE, bag_typestore, decode_cdr
from panoptic_ros.io.storages import ForeignTopic, Storage, is_storage, merged, opened
from panoptic_ros.io.storages.opening import ROS_1_SUFFIX, Ros1BagError, of_ros_1, unpacked_message
from panoptic_ros.io.storages.storage import NEVER_NS, MessageBatch, Row
from panoptic_ros.io.takes import sync_files

RESULT_BAG = "bag"  # name of the bag in the results of `panoptic run`


class BagWriter:
    """Writer of a bag that appears under its final name only after it is closed without an error.

    Use it as a context manager. After an exception no files remain.

    Args:
        in_place: write under the final name from the start, without metadata.yaml until the bag is closed.
            The data then remain in any case, and `io.salvage` can read them. For data that cannot be recorded
            again.

    Raises:
        DataError: if the path exists already.
        EnvironmentProblem: on a full disk or missing permission.
    """

    def __init__(self, path: Path, in_place: bool = False):
        self.path = Path(path)
        if os.path.lexists(self.path):  # true also for a broken link
            raise DataError(f"{self.path} exists already; choose another name or remove it")
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
        self._connections: dict[str | tuple[str, str, tuple[Any, ...]], Any] = {}
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
        """Append a message as CDR bytes with the message definition from another bag."""
        # one connection for each combination of topic, type and QoS
        key = connection.topic, connection.kind, connection.qualities
        with file_errors(self.path, "write"):
            if key not in self._connections:
                self._connections[key] = self._writer.add_connection(
                    connection.topic,
                    connection.kind,
                    msgdef=connection.definition,
                    rihs01=digest_of(connection),
                    offered_qos_profiles=connection.qualities,
                )
            self._writer.write(self._connections[key], stamp_ns, data)

    @property
    def folder(self) -> Path:
        """Return the temporary folder of the bag, for other files that are needed during writing."""
        return self._part

    def write(self, topic: str, stamp_ns: int, message: Any) -> None:
        """Append a message object of the family `bag_messages()`."""
        kind = message.__msgtype__
        self.write_raw(topic, kind, stamp_ns, bytes(bag_typestore().serialize_cdr(message, kind)))

    def close(self) -> None:
        """Finish the bag and move it to its final name."""
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
        """Write all messages so far to the disk as a chunk.

        A kill or power cut then loses only later messages.
        """
        storage: Any = self._writer.storage
        with file_errors(self.path, "write"):
            if storage.chunk.bio.tell():
                storage.close_chunk()
            storage.bio.flush()
            os.fsync(storage.bio.fileno())

    def discard(self) -> None:
        """Abort and remove the files. A bag written at its final path (`in_place`) keeps the data so far."""
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


class PartBagWarning(UserWarning):
    """A bag holds less than its metadata state, or messages that cannot be read."""


def is_bag(path: Path) -> bool:
    """Return whether a path is that of a bag: a folder with metadata, or one of its files."""
    return (path / NAME).is_file() or (path.is_file() and (is_storage(path) or path.suffix == ROS_1_SUFFIX))


def bag_in(path: Path) -> Path | None:
    """Return the bag at a path, or the bag of the results of a run at the path; None if there is none."""
    return next((place for place in (path, path / RESULT_BAG) if is_bag(place)), None)


class BagReader:
    """Reader of a bag: its topics, and its messages in the order of recording.

    The reader reads all messages of the files, independent of the counts in the metadata. A `PartBagWarning`
    names differing counts, topics that are not ROS 2, and missing files. Several iterations may run in
    parallel, also in separate threads.

    Raises:
        DataError: if it is not a bag, was never finished, or is damaged.
    """

    def __init__(self, path: Path):
        self.path = Path(path)
        if not self.path.exists():
            raise DataError(f"there is no bag {self.path}")
        self._reading = threading.Lock()
        self._stack = ExitStack()
        try:
            self._storages, self._metadata, problems = self._opened()
        except (DataError, EnvironmentProblem):
            self._stack.close()
            raise
        self._connections: dict[str, Connection] = {}
        self.counts: dict[str, int] = {}
        foreign: Counter[ForeignTopic] = Counter()
        for held in (storage.contents for storage in self._storages):
            for number, known in held.topics.items():
                known = known._replace(digest=known.digest or self._metadata.digests.get(known.topic, ""))
                before = self._connections.setdefault(known.topic, known)
                if not before.definition and known.definition:
                    self._connections[known.topic] = known
                self.counts[known.topic] = self.counts.get(known.topic, 0) + held.counts.get(number, 0)
            for number, other in held.foreign.items():
                foreign[other] += held.counts.get(number, 0)
            problems += held.problems
        self.topics: dict[str, str] = {topic: known.kind for topic, known in self._connections.items()}
        self.begin_ns = min(storage.contents.begin_ns for storage in self._storages)
        last_ns = max(storage.contents.end_ns for storage in self._storages)
        self.end_ns = last_ns + 1 if self.begin_ns < NEVER_NS else 0
        self.length_s = max(0, self.end_ns - self.begin_ns) * 1e-9
        self._tell(foreign, problems)

    def _opened(self) -> tuple[list[Storage], BagMetadata, list[str]]:
        """Return the open files, their metadata, and lines about missing files.

        Raises:
            DataError: if one of the files cannot be read.
        """
        try:
            if self.path.is_file():
                return [opened(self.path, self._stack)], BagMetadata(), []
            if not (self.path / NAME).is_file() and (old := next(self.path.glob(f"*{ROS_1_SUFFIX}"), None)):
                raise of_ros_1(old)
            metadata = read_metadata(self.path)
            files = chosen_files(self.path, metadata)
            return [opened(path, self._stack) for path in files.paths], metadata, list(files.problems)
        except (EnvironmentProblem, Ros1BagError):
            raise
        except Exception as error:  # a damaged file can raise any exception
            raise DataError(
                f"{self.path} cannot be read as a rosbag2 ({one_line(error)}); if a recording was cut off, "
                f"`panoptic bag repair {self.path}` saves its intact part"
            ) from None

    def _tell(self, foreign: Counter[ForeignTopic], problems: list[str]) -> None:
        """Warn of all content of the bag that is not read.

        Raises:
            DataError: if nothing in the bag can be read.
        """
        kinds: dict[str, list[str]] = {}
        for (topic, what), count in foreign.items():
            if count or not self.topics:
                kinds.setdefault(what, []).append(topic)
        told = "; ".join(
            f"{', '.join(topics[:3])}{', ...' * (len(topics) > 3)} ({what})" for what, topics in kinds.items()
        )
        if foreign and not self.topics:
            self.close()
            remedy = "convert the bag with rosbags-convert" if "ROS 1" in kinds else "record with ROS 2"
            raise DataError(f"{self.path} holds no messages of ROS 2, which are in CDR, but {told}; {remedy}")
        there = Counter(self.counts)
        for other, count in foreign.items():
            there[other.topic] += count
        if told:
            problems.append(f"only messages of ROS 2 are read; left out: {told}")
        if difference := count_difference(self._metadata.counts, there):
            problems.append(difference)
        for problem in problems:
            warnings.warn(f"{self.path}: {problem}", PartBagWarning, stacklevel=1)

    def messages(self, *topics: str) -> Iterator[tuple[str, int, Any]]:
        """Yield (topic, recording time in ns, message) of the given topics, or of all.

        Raises:
            DataError: if a message cannot be read.
        """
        for topic, stamp, data, kind in self.raw(*topics):
            yield topic, stamp, self._decode(topic, data, kind)

    def first(self, *topics: str) -> Iterator[tuple[str, int, bytes, str]]:
        """Yield the first message among these topics, in the form of `raw`; nothing if they have none."""
        if set(topics) & set(self.topics):
            yield from islice(self.raw(*topics), 1)

    def raw(
        self,
        *topics: str,
        begin_ns: int | None = None,
        end_ns: int | None = None,
        on_bad: Callable[[DataError], None] | None = None,
    ) -> Iterator[tuple[str, int, bytes, str]]:
        """Yield (topic, recording time in ns, CDR bytes, type) of the given topics, or of all.

        Args:
            begin_ns, end_ns: recording times to read, [begin_ns, end_ns).
            on_bad: called with the error of every message of an older version that cannot be converted. The
                message is skipped. None = raise the error.

        Raises:
            DataError: if the bag is damaged, or holds messages of this project in another version that cannot
                be converted.
        """
        begin, end = -NEVER_NS if begin_ns is None else begin_ns, NEVER_NS if end_ns is None else end_ns
        ways: list[dict[int, tuple[str, str, Callable[[bytes], bytes] | None]]] = []
        parts = []
        for storage in self._storages:
            held = storage.contents
            chosen = {n: c for n, c in held.topics.items() if not topics or c.topic in topics}
            if not chosen:
                continue
            ways.append({n: (c.topic, c.kind, self._brought_up(c)) for n, c in chosen.items()})
            parts.append(MessageBatch(held.begin_ns, partial(storage.messages, list(chosen), begin, end)))
        try:
            for number, (stamp, topic_number, packed) in self._one_by_one(merged(parts)):
                topic, kind, bring = ways[number][topic_number]
                data = unpacked_message(packed)
                try:
                    data = bring(data) if bring else data
                except Exception as error:  # a converter that meets unexpected bytes can raise any exception
                    bad = DataError(f"{self.path}, topic {topic}: {one_line(error)}")
                    if on_bad is None:
                        raise bad from None
                    on_bad(bad)
                    continue
                yield topic, stamp, data, kind
        except DataError:
            raise
        except Exception as error:  # a damaged file can raise any exception
            raise DataError(
                f"{self.path} is damaged: {one_line(error)}; `panoptic bag repair {self.path}` saves its "
                "intact part"
            ) from None

    def _one_by_one(self, rows: Iterator[tuple[int, Row]]) -> Iterator[tuple[int, Row]]:
        """Yield the rows under a lock: only one thread seeks and reads in the files at a time."""
        while True:
            with self._reading:
                row = next(rows, None)
            if row is None:
                return
            yield row

    def is_outdated(self, topic: str) -> bool:
        """Return whether the topic has a message type of this project in another version.

        The type hash is compared; it comes from the bag or from the definition.
        """
        known = self._connections.get(topic)
        return known is not None and _is_outdated(known)

    def can_be_brought_up(self, topic: str) -> bool:
        """Return whether messages of another version can be converted to the current version."""
        connection = self.connection(topic)
        return bringing_up(connection.kind, connection.definition) is not None

    def connection(self, topic: str) -> Connection:
        """Return a topic with the message definition and QoS that the bag stores."""
        known, words = self._connections[topic], self._metadata.qualities.get(topic)
        if not known.qualities and words:
            with suppress(ValueError):
                return known._replace(qualities=qualities_in(words))
        return known

    def _brought_up(self, connection: Connection) -> Callable[[bytes], bytes] | None:
        """Return a converter from an older message version to the current one; None if none is needed.

        Raises:
            DataError: if the message version cannot be converted.
        """
        topic, kind = connection.topic, connection.kind
        digest = connection.digest or self._connections[topic].digest
        if not _is_outdated(connection._replace(digest=digest)):
            return None
        bring = bringing_up(kind, connection.definition or self._connections[topic].definition)
        if bring is None:
            raise DataError(
                f"{self.path} was recorded by another version of this program, with other fields of "
                f"{kind.split('/')[-1]} (topic {topic}); read it with that version, or make the bag again "
                "from the capture with `panoptic run`"
            )
        return bring

    def _decode(self, topic: str, data: bytes, kind: str) -> Any:
        try:
            return decode_cdr(data, kind)
        except DataError as error:
            raise DataError(f"{self.path}, topic {topic}: {error}") from None

    def close(self) -> None:
        """Close the files."""
        self._stack.close()

    def __enter__(self) -> BagReader:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _is_outdated(connection: Connection) -> bool:
    store, kind = bag_typestore(), connection.kind
    if not kind.startswith(f"{PACKAGE}/") or kind not in store.types:
        return False
    digest = digest_of(connection)
    return digest != UNKNOWN_DIGEST and digest != store.hash_rihs01(kind)


@dataclass(frozen=True)
class UpgradeResult:
    """Result of an upgrade.

    Args:
        brought_up: topics whose messages were converted.
        kept: topics whose messages were copied unchanged.
        left_out: message type of each topic that cannot be converted.
    """

    brought_up: tuple[str, ...]
    kept: tuple[str, ...]
    left_out: dict[str, str]


def upgrade(source: Path, target: Path) -> UpgradeResult | None:
    """Rewrite a bag with the current message types; return None and write nothing if it is up to date.

    Messages of other packages are copied with their own definitions.

    Args:
        target: must not exist yet.

    Raises:
        DataError: if the bag cannot be read, or no topic can be converted.
    """
    with BagReader(source) as bag:
        outdated = [topic for topic in bag.topics if bag.is_outdated(topic)]
        if not outdated:
            return None
        left_out = {topic: bag.topics[topic] for topic in outdated if not bag.can_be_brought_up(topic)}
        wanted = [topic for topic in bag.topics if topic not in left_out]
        if not wanted:
            raise DataError(f"{source}: no topic in it can be upgraded; make the bag again from the capture")
        with BagWriter(target) as new:
            for topic, stamp_ns, data, kind in bag.raw(*wanted):
                if topic in outdated:
                    new.write_raw(topic, kind, stamp_ns, data)
                else:
                    new.write_described(bag.connection(topic), stamp_ns, data)
    kept = tuple(topic for topic in wanted if topic not in outdated)
    return UpgradeResult(tuple(topic for topic in outdated if topic not in left_out), kept, left_out)
