"""What salvaging finds in a file."""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

from panoptic_ros.io.bag_connections import Connection


class Message(NamedTuple):
    """A whole message: when it was recorded (ns), and its bytes."""

    connection: Connection
    stamp_ns: int
    data: bytes


class Losses:
    """Losses of a bag, one line each; a whole bag has none."""

    def __init__(self) -> None:
        self._lines: list[str] = []
        self._counts: Counter[tuple[str, str]] = Counter()  # by file and what is lost of it

    @property
    def lines(self) -> list[str]:
        """Return all lines, those with counts at the end."""
        return self._lines + [f"{name}: {count} {what}" for (name, what), count in self._counts.items()]

    def add(self, line: str) -> None:
        """Add a line."""
        self._lines.append(line)

    def count(self, name: str, what: str) -> None:
        """Count one more loss of a file."""
        self._counts[name, what] += 1
