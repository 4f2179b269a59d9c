"""Opening files of several cameras at a time: FFmpeg reads and decodes outside of Python's lock."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Protocol, TypeVar

AT_ONCE = 4  # more gain little, and each holds a decoder

Name = TypeVar("Name")


class Closes(Protocol):
    """What is open."""

    def close(self) -> None:
        """Close it."""


Opened = TypeVar("Opened", bound=Closes)


def opened_at_once(open_one: Callable[[Name], Opened], names: Iterable[Name]) -> list[Opened]:
    """What a function opens of each of these names, in their order.

    Raises:
        what the function raises of the first name for which it does; all others are closed then.
    """
    with ThreadPoolExecutor(AT_ONCE) as pool:
        tasks = [pool.submit(open_one, name) for name in names]
    try:
        return [task.result() for task in tasks]
    except BaseException:
        for task in tasks:
            with suppress(Exception):  # one that failed, too
                task.result().close()
        raise
