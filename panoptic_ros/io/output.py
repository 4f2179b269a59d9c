"""Output of a process: to a file, and to streams whose reader may end."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


def print_to(path: Path | str) -> None:
    """Let this process print to the end of a file, and read nothing."""
    output = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o666)
    for number, descriptor in ((0, os.open(os.devnull, os.O_RDONLY)), (1, output), (2, output)):
        os.dup2(descriptor, number)


class LossyStream:
    """A text stream whose reader may vanish: what cannot be written is lost, and raises nothing.

    A closed terminal (EIO), a pipe without a reader (EPIPE) and a full disk (ENOSPC) end the printing.

    Args:
        stream: all other attributes are those of this stream.
    """

    def __init__(self, stream: Any):
        self._stream = stream

    def write(self, text: str) -> int:
        """Write a text if that is possible."""
        try:
            self._stream.write(text)
        except (OSError, ValueError):  # ValueError: the stream is closed
            pass
        return len(text)

    def flush(self) -> None:
        """Flush if that is possible."""
        try:
            self._stream.flush()
        except (OSError, ValueError):
            pass

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextmanager
def lossy_output() -> Iterator[None]:
    """Let a dead terminal or pipe end the printing within it, and nothing else."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = LossyStream(before[0]), LossyStream(before[1])
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before
