"""How much can run side by side on the cores that this process may use."""

from __future__ import annotations

import os


def free_threads(each: int) -> int:
    """How many looks of `each` threads the cores that this process may use can do at a time."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, cores // each)
