"""Computes how many detections can run in parallel on the cores that this process may use."""

from __future__ import annotations

import os


def free_threads(each: int) -> int:
    """Return the number of parallel detections, of `each` threads, on the cores that this process may use."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, cores // each)
