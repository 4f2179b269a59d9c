"""One file of a bag: its topics, how many messages each has, and the messages in the order of recording."""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, Protocol

from panoptic_ros.io.bag_connections import Connection

Row = tuple[int, int, bytes]  # recording stamp ns, number of the topic in the file, bytes of the message
SUFFIXES = (".mcap", ".db3")
PACKED = (".zstd", ".zst")  # endings of packed files behind these
NEVER_NS = 2**63 - 1  # later than all stamps


class Foreign(NamedTuple):
    """A topic whose messages cannot be read, and what they are."""

    topic: str
    what: str


class Contents(NamedTuple):
    """Contents of a file of a bag.

    Args:
        topics: by number in the file.
        foreign: by number, those that cannot be read.
        counts: messages by number, of both.
        begin_ns, end_ns: stamps of the first and the last message; without messages the first is later.
        problems: a line for everything that the file states and does not hold.
    """

    topics: Mapping[int, Connection]
    foreign: Mapping[int, Foreign]
    counts: Mapping[int, int]
    begin_ns: int
    end_ns: int
    problems: Sequence[str] = ()


class Storage(Protocol):
    """A file of a bag."""

    @property
    def contents(self) -> Contents:
        """Return what the file holds."""

    def messages(self, numbers: Collection[int], begin_ns: int, end_ns: int) -> Iterator[Row]:
        """Yield the messages of some topics with recording stamps in [begin_ns, end_ns), in their order."""

    def close(self) -> None:
        """Close the file."""


class Part(NamedTuple):
    """Messages in their order, none of which is before `begin_ns`."""

    begin_ns: int
    rows: Callable[[], Iterator[Row]]


def merged(parts: Sequence[Part]) -> Iterator[tuple[int, Row]]:
    """Yield the messages of all parts in their order, each with the number of its part.

    A part is opened when its time has come, so that a long recording is never in memory as a whole. Messages
    of one stamp come in the order of the parts.
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
    """Return whether a file is named as one of a bag is, packed or not."""
    name = path.name.removesuffix(next((end for end in PACKED if path.name.endswith(end)), ""))
    return name.endswith(SUFFIXES)
