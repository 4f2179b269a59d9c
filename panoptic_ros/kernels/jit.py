"""`njit` of this package, and a monitor of compilations."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

import numba
from numba.core import event

from panoptic_ros.kernels.cache import SETTINGS, KernelCache

Function = TypeVar("Function", bound=Callable[..., Any])


def njit(**options: Any) -> Callable[[Function], Function]:
    """Return numba's `njit` decorator with these options, which stores compiled code in this package's cache.

    A type checker sees the undecorated function, so calls of kernels are checked like all other calls.
    """

    def compiled(function: Function) -> Function:
        dispatcher: Any = numba.njit(**{**options, "cache": False, "no_cfunc_wrapper": True})(function)
        if not SETTINGS.DISABLE_JIT:
            dispatcher._cache = KernelCache(function)
        kernel: Function = dispatcher
        return kernel

    return compiled


# For parts of kernels: they are inlined, without reference counts, which often cost more than the part
# itself. So a record of many arrays is as cheap an argument as one number. Such a part must neither make nor
# return arrays.
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
    """Within this context, call `told` when the compilation of a function begins, and `ended` when it ends.

    Kernels that are loaded from the cache are not reported. Both functions are called in the thread that
    compiles. Compilations in other threads are reported too. `told` gets the full name of the function.
    """
    listener = _Compilations(told, ended)
    event.register("numba:compile", listener)
    try:
        yield
    finally:
        event.unregister("numba:compile", listener)
