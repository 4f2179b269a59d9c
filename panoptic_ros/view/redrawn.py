"""Lines that are redrawn in place in a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TextIO


class RedrawnLines:
    """Lines in a terminal, of which each drawing replaces the one before."""

    def __init__(self, stream: TextIO):
        self._stream, self._up = stream, 0

    def draw(self, lines: Sequence[str]) -> None:
        """Draw lines over the last drawing."""
        up = f"\x1b[{self._up}A" if self._up else ""
        self._stream.write(up + "".join(f"\r{line}\x1b[K\n" for line in lines) + "\x1b[J")
        self._stream.flush()
        self._up = len(lines)
