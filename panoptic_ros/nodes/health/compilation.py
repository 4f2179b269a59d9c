"""Telling in the log and on /diagnostics that a node compiles kernels, and takes no data meanwhile."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

from panoptic_ros.kernels import on_compilation

TEXT = (
    "kernels are not compiled yet: the node takes data in about half a minute, once per installation; "
    "`panoptic warm-up` does it ahead"
)
TELL_S = 1.0


class Compilation:
    """What is being compiled now, from when this is made until `close`.

    Args:
        tell: called when something begins to be compiled, at most once a second, in the thread that does it.
        clock: s.
    """

    def __init__(self, logger: Any, tell: Callable[[], None], clock: Callable[[], float] = time.monotonic):
        self._logger, self._tell, self._clock = logger, tell, clock
        self._under_way: list[str] = []  # a kernel, then what it needs
        self._logged = False
        self._told_s = -TELL_S
        self._stack = ExitStack()
        self._stack.enter_context(on_compilation(self._begins, self._ends))

    @property
    def kernel(self) -> str:
        """The name of what is being compiled; "" if nothing is."""
        names = self._under_way
        return names[0].removeprefix("panoptic_ros.") if names else ""

    def close(self) -> None:
        """Watch no more."""
        self._stack.close()

    def _begins(self, kernel: str) -> None:
        self._under_way = [*self._under_way, kernel]
        if not kernel.startswith("panoptic_ros."):
            return
        if not self._logged:
            self._logged = True
            self._logger.warning(TEXT)
        now_s = self._clock()
        if now_s - self._told_s >= TELL_S:
            self._told_s = now_s
            self._tell()

    def _ends(self) -> None:
        self._under_way = self._under_way[:-1]
