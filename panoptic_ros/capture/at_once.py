"""Open the files of several cameras in parallel: FFmpeg reads and decodes without Python's global lock."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Protocol, TypeVar

AT_ONCE = 4  # more threads gain little, and each holds a decoder

Name = TypeVar("Name")


class Closeable(Protocol):
    """An open resource."""

    def close(self) -> None:
        """Close it."""


Opened = TypeVar("Opened", bound=Closeable)


def opened_at_once(open_one: Callable[[Name], Opened], names: Iterable[Name]) -> list[Opened]:
    """Open all names in parallel with a function, and return the results in the order of the names.

    Raises:
        Exception: the function's exception for the first name that failed; all other results are closed.
    """
    with ThreadPoolExecutor(AT_ONCE) as pool:
        tasks = [pool.submit(open_one, name) for name in names]
    try:
        return [task.result() for task in tasks]
    except BaseException:
        for task in tasks:
            with suppress(Exception):  # a failed task raises its own error again
                task.result().close()
        raise
