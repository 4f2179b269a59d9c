"""SQLite3 files of bags that end too early or are damaged: the messages that can still be read."""

from __future__ import annotations

import shutil
import sqlite3
import tempfile
from collections.abc import Iterator
from pathlib import Path

from panoptic_ros.io.salvage.found import Losses, Message
from panoptic_ros.io.salvage.mcap import left_out, odd_quality
from panoptic_ros.io.storages.sqlite import JOURNALS, topics_of

LONGEST_STEP = 2**40  # row numbers that are passed over behind a damaged one, at most


def sqlite_messages(path: Path, losses: Losses, scratch: Path) -> Iterator[Message]:
    """The messages of a file, in the order in which they were written.

    The work is done on a copy with its journal, as SQLite mends what it opens.

    Args:
        scratch: folder for the copy.
        losses: is told what cannot be read.
    """
    with tempfile.TemporaryDirectory(prefix="panoptic-repair-", dir=scratch) as folder:
        copy = Path(folder, path.name)
        for suffix in ("", *JOURNALS):
            if (part := path.with_name(path.name + suffix)).exists():
                shutil.copyfile(part, copy.with_name(copy.name + suffix))
        _cut_to_pages(copy)
        base = sqlite3.connect(copy)
        try:
            # else SQLite refuses all of a file that is shorter than its first page says
            base.execute("PRAGMA writable_schema=ON")
            yield from _messages(base, path.name, losses)
        except sqlite3.DatabaseError as error:
            losses.add(f"{path.name}: all of it ({error})")
        finally:
            base.close()


def _cut_to_pages(path: Path) -> None:
    """Leave out a page that is not whole: SQLite would take what is missing of it for zeros."""
    with path.open("r+b") as file:
        size = int.from_bytes(file.read(18)[16:18], "big")
        page = 65536 if size == 1 else max(512, size)
        file.truncate(path.stat().st_size // page * page)


def _messages(base: sqlite3.Connection, name: str, losses: Losses) -> Iterator[Message]:
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
                if number <= last:  # pages that lead back to others
                    raise sqlite3.DatabaseError("rows are not in order")
                if (other := topics.foreign.get(topic)) is not None:
                    losses.count(name, left_out(other))
                    last, step = number, 1
                    continue
                message = Message(topics.known[topic], int(stamp), bytes(data))
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
