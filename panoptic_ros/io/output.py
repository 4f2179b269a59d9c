"""Redirect the output of a process to a file, or to streams whose reader may disappear."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


def print_to(path: Path | str) -> None:
    """Append the output of this process to a file, and connect its input to /dev/null."""
    output = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o666)
    for number, descriptor in ((0, os.open(os.devnull, os.O_RDONLY)), (1, output), (2, output)):
        os.dup2(descriptor, number)


class LossyStream:
    """A text stream whose reader may disappear: text that cannot be written is lost without an error.

    A closed terminal (EIO), a pipe without a reader (EPIPE) and a full disk (ENOSPC) only stop the output.

    Args:
        stream: receives the text and all other attribute accesses.
    """

    def __init__(self, stream: Any):
        self._stream = stream

    def write(self, text: str) -> int:
        """Write a text; ignore a failure."""
        try:
            self._stream.write(text)
        except (OSError, ValueError):  # ValueError: the stream is closed
            pass
        return len(text)

    def flush(self) -> None:
        """Flush the stream; ignore a failure."""
        try:
            self._stream.flush()
        except (OSError, ValueError):
            pass

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextmanager
def lossy_output() -> Iterator[None]:
    """Replace stdout and stderr within the block: a closed terminal or pipe then stops only the output."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = LossyStream(before[0]), LossyStream(before[1])
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before
