"""Work that waits in lines: of each line one thing after the other, of all lines side by side."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any

Work = tuple["Future[Any]", Callable[[], Any]]


class Lines:
    """What is done on a pool for cameras that must not wait for each other, each image after the one before.

    Args:
        pool: whoever is free takes what has waited longest, of those lines that nobody works on.
    """

    def __init__(self, pool: Executor):
        self._pool = pool
        self._lines: dict[str, deque[Work]] = {}  # those on which somebody works
        self._changing = threading.Lock()

    def add(self, line: str, call: Callable[[], Any]) -> Future[Any]:
        """Do this once all that was added to the line before is done."""
        future: Future[Any] = Future()
        with self._changing:
            idle = line not in self._lines
            self._lines.setdefault(line, deque()).append((future, call))
        if idle:
            self._pool.submit(self._do_next, line)
        return future

    def _do_next(self, line: str) -> None:
        with self._changing:
            future, call = self._lines[line].popleft()
        try:
            result = call()
        except BaseException as error:  # is raised again where the result is taken
            self._go_on(line)
            future.set_exception(error)
        else:
            self._go_on(line)
            future.set_result(result)

    def _go_on(self, line: str) -> None:
        with self._changing:
            if not self._lines[line]:
                del self._lines[line]
                return
        self._pool.submit(self._do_next, line)
