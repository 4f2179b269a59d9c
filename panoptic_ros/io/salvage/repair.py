"""Bringing a cut bag back: all messages that are whole, in a new bag that opens everywhere."""
from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from rosbags.rosbag2.storage_mcap import DECOMPRESSORS

from panoptic_ros.errors import DataError
from panoptic_ros.io.bags import BagWriter
from panoptic_ros.io.files import file_errors
from panoptic_ros.io.salvage.found import Losses, Message
from panoptic_ros.io.salvage.mcap import mcap_messages
from panoptic_ros.io.salvage.sqlite import sqlite_messages

READERS: dict[str, Callable[[Path, Losses, Path], Iterator[Message]]] = {
    ".mcap": mcap_messages,
    ".db3": sqlite_messages,
}
ZSTD = b"\x28\xb5\x2f\xfd"  # CDR begins with 0


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
    counts: dict[str, int] = {}
    losses, stamps = Losses(), [2**63, 0]
    with BagWriter(target) as bag:
        for path in files_of(source):
            with file_errors(path, "read"):
                for connection, stamp_ns, data in READERS[path.suffix](path, losses, bag.folder):
                    bag.write_described(connection, stamp_ns, _unpacked(data))
                    counts[connection.topic] = counts.get(connection.topic, 0) + 1
                    stamps = [min(stamps[0], stamp_ns), max(stamps[1], stamp_ns)]
        if not counts:
            told = f": {'; '.join(losses.lines)}" if losses.lines else ""
            raise DataError(f"{source} has no whole message{told}")
    return Repair(counts, tuple(losses.lines), *stamps)


def _unpacked(data: bytes) -> bytes:
    """A message that was compressed by itself; metadata.yaml, which tells of that, may be missing."""
    return DECOMPRESSORS["zstd"](data, 0) if data.startswith(ZSTD) else data


def files_of(source: Path) -> list[Path]:
    """The files of a bag in the order of recording.

    Raises:
        DataError: if there are none.
    """
    if not source.exists():
        raise DataError(f"there is no bag {source}")
    found = [source] if source.is_file() else list(source.iterdir())
    files = sorted((path for path in found if path.suffix in READERS), key=_by_numbers)
    if not files:
        raise DataError(f"{source} holds no file of a bag ({', '.join(READERS)})")
    return files


def _by_numbers(path: Path) -> list[tuple[int, str]]:
    """bag_2 goes before bag_10."""
    words = re.split(r"(\d+)", path.name)
    return [(int(word), "") if word.isdigit() else (0, word) for word in words]
