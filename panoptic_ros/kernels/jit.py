"""`njit` of this package."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
from numba.core.dispatcher import Dispatcher

from panoptic_ros.kernels.cache import KernelCache


def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """numba's `njit` with the options that it takes; compiled code is kept in this package's cache."""

    def compiled(function: Callable[..., Any]) -> Dispatcher:
        dispatcher = numba.njit(**options)(function)
        dispatcher._cache = KernelCache(function)
        return dispatcher

    return compiled
