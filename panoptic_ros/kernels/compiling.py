"""Telling that something is being compiled."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from numba.core import event


class _Compilations(event.Listener):
    def __init__(self, told: Callable[[str], None], ended: Callable[[], None]):
        self._told, self._ended = told, ended

    def on_start(self, event: Any) -> None:
        function = event.data["dispatcher"].py_func
        self._told(f"{function.__module__}.{function.__qualname__}")

    def on_end(self, event: Any) -> None:
        self._ended()


@contextmanager
def on_compilation(told: Callable[[str], None], ended: Callable[[], None] = lambda: None) -> Iterator[None]:
    """While this holds, call `told` with the full name of every function when its compilation begins, and
    `ended` when it ends.

    Kernels that are taken from the cache are not told. Both are called in the thread that compiles; what
    other threads compile meanwhile is told too.
    """
    listener = _Compilations(told, ended)
    event.register("numba:compile", listener)
    try:
        yield
    finally:
        event.unregister("numba:compile", listener)
