"""`njit` of this package."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba

from panoptic_ros.kernels.cache import KernelCache

NO_WRAPPER: dict[str, Any] = {"no_cfunc_wrapper": True}  # nothing in C calls kernels
Function = TypeVar("Function", bound=Callable[..., Any])


def njit(**options: Any) -> Callable[[Function], Function]:
    """numba's `njit` with the options that it takes; compiled code is kept in this package's cache.

    A type checker sees the function as it is written, so calls of kernels are checked as all others are.
    """

    def compiled(function: Function) -> Function:
        dispatcher: Any = numba.njit(**options, **NO_WRAPPER)(function)
        dispatcher._cache = KernelCache(function)
        kernel: Function = dispatcher
        return kernel

    return compiled


# For parts of kernels: inlined, and without counts of references, which cost more than many a part does. So a
# record of many arrays is as cheap an argument as one number; but a part neither makes nor returns arrays.
inlined = njit(cache=True, error_model="numpy", nogil=True, forceinline=True, _nrt=False)
