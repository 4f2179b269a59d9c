"""What salvaging finds in a file."""
from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from panoptic_ros.io.bag_connections import Connection


class Message(NamedTuple):
    """A whole message: when it was recorded (ns), and its CDR bytes."""

    connection: Connection
    stamp_ns: int
    data: bytes


@dataclass
class Losses:
    """What could not be read of a file, one line each; none: it is whole."""

    lines: list[str] = field(default_factory=list)

    def add(self, line: str) -> None:
        """One more."""
        self.lines.append(line)
