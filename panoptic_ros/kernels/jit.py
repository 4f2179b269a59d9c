"""`njit` of this package."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba

from panoptic_ros.kernels.cache import IS_KNOWN, SETTINGS, KernelCache
from panoptic_ros.kernels.parts import Kernel

NO_WRAPPER: dict[str, Any] = {"no_cfunc_wrapper": True}  # nothing in C calls kernels
Function = TypeVar("Function", bound=Callable[..., Any])


def njit(**options: Any) -> Callable[[Function], Function]:
    """numba's `njit` with the options that it takes; compiled code is kept in this package's cache.

    A type checker sees the function as it is written, so calls of kernels are checked as all others are.
    """

    def compiled(function: Function) -> Function:
        dispatcher: Any = _dispatcher(function, {**options, **NO_WRAPPER})
        if not SETTINGS.DISABLE_JIT:
            dispatcher._cache = KernelCache(function)
        kernel: Function = dispatcher
        return kernel

    return compiled


def _dispatcher(function: Function, options: dict[str, Any]) -> Any:
    if SETTINGS.DISABLE_JIT or not IS_KNOWN:
        return numba.njit(**options)(function)
    return Kernel(function, {**{k: v for k, v in options.items() if k != "cache"}, "nopython": True})


# For parts of kernels: inlined, and without counts of references, which cost more than many a part does. So a
# record of many arrays is as cheap an argument as one number; but a part neither makes nor returns arrays.
inlined = njit(cache=True, error_model="numpy", nogil=True, forceinline=True, _nrt=False)
