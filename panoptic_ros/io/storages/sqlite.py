"""Read SQLite3 bag files."""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import NamedTuple

from panoptic_ros.io.bag_connections import CDR, Connection, full_kind, qualities_of, serialization_but_cdr
from panoptic_ros.io.storages.storage import NEVER_NS, Contents, ForeignTopic, Row

MAGIC = b"SQLite format 3\0"
JOURNALS = ("-wal", "-journal")  # suffixes of the files that SQLite keeps beside a file that is being written


class TopicRows(NamedTuple):
    """Topics of a file: readable and unreadable ones by number, and (topic, QoS text) with invalid QoS."""

    known: dict[int, Connection]
    foreign: dict[int, ForeignTopic]
    odd: tuple[tuple[str, str], ...]


class SqliteStorage:
    """Storage of an SQLite3 file, see `storage.Storage`.

    Raises:
        sqlite3.Error: if the file is damaged.
    """

    def __init__(self, path: Path):
        # open without the journal: SQLite would otherwise change the file
        self._base = sqlite3.connect(
            f"{path.resolve().as_uri()}?immutable=1", uri=True, check_same_thread=False
        )
        try:
            topics = topics_of(self._base)
            rows = self._base.execute(
                "SELECT topic_id, COUNT(*), MIN(timestamp), MAX(timestamp) FROM messages GROUP BY topic_id"
            ).fetchall()
        except BaseException:
            self._base.close()
            raise
        begin = min((row[2] for row in rows), default=NEVER_NS)
        end = max((row[3] for row in rows), default=0)
        journals = (path.with_name(path.name + suffix) for suffix in JOURNALS)
        problems = [
            f"messages that are in {beside.name} alone are not read; `panoptic bag repair` reads them"
            for beside in journals
            if beside.is_file() and beside.stat().st_size
        ]
        self.contents = Contents(
            topics.known, topics.foreign, {row[0]: row[1] for row in rows}, begin, end, problems
        )

    def messages(self, numbers: Collection[int], begin_ns: int, end_ns: int) -> Iterator[Row]:
        """Yield messages in the order of recording, see `storage.Storage`."""
        chosen = ", ".join(str(int(number)) for number in numbers)
        yield from self._base.execute(
            f"SELECT timestamp, topic_id, data FROM messages WHERE topic_id IN ({chosen}) AND timestamp >= ? "
            "AND timestamp < ? ORDER BY timestamp, id",
            (begin_ns, end_ns),
        )

    def close(self) -> None:
        """Close the file."""
        self._base.close()


def topics_of(base: sqlite3.Connection) -> TopicRows:
    """Return the topics of a file of any rosbag2 version.

    Raises:
        sqlite3.Error: if it is damaged.
    """
    columns = {row[1] for row in base.execute("PRAGMA table_info(topics)")}
    definitions: dict[str, tuple[str, str]] = {}
    if base.execute("PRAGMA table_info(message_definitions)").fetchall():
        definitions = {
            str(kind): (str(language), str(text))
            for kind, language, text in base.execute(
                "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
            )
        }
    usual = {"serialization_format": CDR, "offered_qos_profiles": "", "type_description_hash": ""}
    more = ", ".join(name if name in columns else f"'{value}'" for name, value in usual.items())
    found = TopicRows({}, {}, ())
    odd: list[tuple[str, str]] = []
    for number, *words in base.execute(f"SELECT id, name, type, {more} FROM topics"):
        topic, kind, serialization, quality, digest = (str(word or "") for word in words)
        language, definition = definitions.get(kind, ("", ""))
        kind = full_kind(kind)
        if what := serialization_but_cdr(serialization, language, kind):
            found.foreign[number] = ForeignTopic(topic, what)
            continue
        try:
            qualities = qualities_of(quality)
        except ValueError:
            odd.append((topic, quality))
            qualities = ()
        found.known[number] = Connection(topic, kind, definition, digest, qualities)
    return found._replace(odd=tuple(odd))
