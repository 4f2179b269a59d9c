"""Bringing a cut bag back: all messages that are whole, in a new bag that opens everywhere."""

from __future__ import annotations

import re
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from panoptic_ros.errors import DataError
from panoptic_ros.io.bag_metadata import NAME, count_difference, files_in, read_metadata
from panoptic_ros.io.bags import BagWriter
from panoptic_ros.io.files import file_errors
from panoptic_ros.io.salvage.found import Losses, Message
from panoptic_ros.io.salvage.mcap import mcap_messages
from panoptic_ros.io.salvage.sqlite import sqlite_messages
from panoptic_ros.io.storages import is_storage, packed_name, unpack
from panoptic_ros.io.storages.opening import ROS_1_SUFFIX, of_ros_1, unpacked_message

READERS: dict[str, Callable[[Path, Losses, Path], Iterator[Message]]] = {
    ".mcap": mcap_messages,
    ".db3": sqlite_messages,
}


@dataclass(frozen=True)
class Repair:
    """What came of it.

    Args:
        counts: saved messages by topic. lost: a line for whatever could not be read; empty: nothing was lost.
        begin_ns, end_ns: when the first and the last message were recorded.
    """

    counts: dict[str, int]
    lost: tuple[str, ...]
    begin_ns: int
    end_ns: int


def repair(source: Path, target: Path) -> Repair:
    """Write what is whole in a bag to a new one; the old one stays as it is.

    Args:
        source: folder of a bag, with or without metadata.yaml, or one of its files.
        target: must not be there yet.

    Raises:
        DataError: if there are no files of a bag, or no message in them is whole.
    """
    counts: Counter[str] = Counter()
    losses, stamps = Losses(), [2**63, 0]
    files = files_of(source)
    with BagWriter(target) as bag:
        for path in files:
            with file_errors(path, "read"):
                for connection, stamp_ns, packed in _messages(path, losses, bag.folder):
                    if (data := _plain(packed)) is None:
                        losses.count(path.name, f"messages on {connection.topic}, which are no CDR")
                        continue
                    bag.write_described(connection, stamp_ns, data)
                    counts[connection.topic] += 1
                    stamps = [min(stamps[0], stamp_ns), max(stamps[1], stamp_ns)]
        lost = (*losses.lines, *_missing(source, files, counts, losses))
        if not counts:
            raise DataError(f"{source} has no whole message{': ' if lost else ''}{'; '.join(lost)}")
    return Repair(dict(counts), lost, *stamps)


def _messages(path: Path, losses: Losses, scratch: Path) -> Iterator[Message]:
    """Yield the whole messages of a file, packed or not."""
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
    """Return a message without its own packing; None if it is no CDR."""
    try:
        plain = unpacked_message(data)
    except ValueError:
        return None
    return plain if plain[:1] == b"\0" else None  # as all CDR begins


def _missing(source: Path, files: list[Path], counts: Counter[str], losses: Losses) -> Iterator[str]:
    """Yield lines about what metadata.yaml states and nothing else explains."""
    try:
        metadata = read_metadata(source)
    except DataError:  # it is not needed
        return
    there = {packed_name(path) for path in files}
    missing = [name for name in metadata.files if packed_name(Path(name)) not in there]
    yield from (f"{name}: all of it, as it is not there, and {NAME} names it" for name in missing)
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
    """bag_2 goes before bag_10."""
    words = re.split(r"(\d+)", path.name)
    return [(int(word), "") if word.isdigit() else (0, word) for word in words]
