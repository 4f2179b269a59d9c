"""`njit` of this package, and what tells that it compiles."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

import numba
from numba.core import event

from panoptic_ros.kernels.cache import SETTINGS, KernelCache

Function = TypeVar("Function", bound=Callable[..., Any])


def njit(**options: Any) -> Callable[[Function], Function]:
    """numba's `njit` with the options that it takes; compiled code is kept in this package's cache.

    A type checker sees the function as it is written, so calls of kernels are checked as all others are.
    """

    def compiled(function: Function) -> Function:
        dispatcher: Any = numba.njit(**{**options, "cache": False, "no_cfunc_wrapper": True})(function)
        if not SETTINGS.DISABLE_JIT:
            dispatcher._cache = KernelCache(function)
        kernel: Function = dispatcher
        return kernel

    return compiled


# For parts of kernels: inlined, and without counts of references, which cost more than many a part does. So a
# record of many arrays is as cheap an argument as one number; but a part neither makes nor returns arrays.
inlined = njit(cache=True, error_model="numpy", nogil=True, forceinline=True, _nrt=False)


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
