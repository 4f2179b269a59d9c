"""Interface of one bag file: its topics, their message counts, and the messages in the order of recording."""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, Protocol

from panoptic_ros.io.bag_connections import Connection

Row = tuple[int, int, bytes]  # recording time (ns), topic number in the file, bytes of the message
SUFFIXES = (".mcap", ".db3")
PACKED = (".zstd", ".zst")  # suffixes of compressed files, which follow `SUFFIXES`
NEVER_NS = 2**63 - 1  # later than every timestamp


class ForeignTopic(NamedTuple):
    """A topic whose messages cannot be read, and the name of their serialization or kind."""

    topic: str
    what: str


class Contents(NamedTuple):
    """Contents of a bag file.

    Args:
        topics: Readable topics by number in the file.
        foreign: Unreadable topics by number in the file.
        counts: Messages by topic number, of both.
        begin_ns, end_ns: Recording times of the first and the last message; without messages, begin_ns >
            end_ns.
        problems: One line for each difference between the file's statements and its content.
    """

    topics: Mapping[int, Connection]
    foreign: Mapping[int, ForeignTopic]
    counts: Mapping[int, int]
    begin_ns: int
    end_ns: int
    problems: Sequence[str] = ()


class Storage(Protocol):
    """Interface of a bag file."""

    @property
    def contents(self) -> Contents:
        """Return the contents of the file."""

    def messages(self, numbers: Collection[int], begin_ns: int, end_ns: int) -> Iterator[Row]:
        """Yield the messages of some topics with recording times in [begin_ns, end_ns), in order of time."""

    def close(self) -> None:
        """Close the file."""


class MessageBatch(NamedTuple):
    """Messages in order of time; all are at or after `begin_ns`."""

    begin_ns: int
    rows: Callable[[], Iterator[Row]]


def merged(parts: Sequence[MessageBatch]) -> Iterator[tuple[int, Row]]:
    """Yield the messages of all parts in order of time, each with the number of its part.

    A part is opened only when its begin time is reached, so a long recording is never completely in memory.
    Messages with equal times are in the order of the parts.
    """
    waiting = deque(sorted(enumerate(parts), key=lambda item: item[1].begin_ns))
    heads: list[tuple[int, int, Row, Iterator[Row]]] = []
    while waiting or heads:
        while waiting and (not heads or waiting[0][1].begin_ns <= heads[0][0]):
            number, part = waiting.popleft()
            rows = part.rows()
            if (row := next(rows, None)) is not None:
                heapq.heappush(heads, (row[0], number, row, rows))
        if not heads:
            continue
        _, number, row, rows = heads[0]
        yield number, row
        if (row_after := next(rows, None)) is None:
            heapq.heappop(heads)
        else:
            heapq.heapreplace(heads, (row_after[0], number, row_after, rows))


def is_storage(path: Path) -> bool:
    """Return whether a file has the name of a bag file, compressed or not."""
    name = path.name.removesuffix(next((end for end in PACKED if path.name.endswith(end)), ""))
    return name.endswith(SUFFIXES)
