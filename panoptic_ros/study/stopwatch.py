"""Measure time and memory of calls; the first call is excluded."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

FEWEST = 1  # lower limit of timed calls, even if they exceed the budget


@dataclass(frozen=True)
class CallTimes:
    """Milliseconds per call: wall time, and processor time of this process.

    Fields: number of calls, then median, 99th percentile and minimum over the calls.
    """

    calls: int
    wall_ms_median: float
    wall_ms_p99: float
    cpu_ms_median: float
    cpu_ms_p99: float
    cpu_ms_least: float
    peak_mb: float | None  # growth of the resident set during the calls; None = not measurable here

    @classmethod
    def of(cls, wall_ms: np.ndarray, cpu_ms: np.ndarray, peak_mb: float | None) -> CallTimes:
        """Compute the statistics from times (N,) in ms of N calls."""
        wall, cpu = (np.percentile(row, [50, 99]).tolist() for row in (wall_ms, cpu_ms))
        return cls(len(wall_ms), wall[0], wall[1], cpu[0], cpu[1], float(cpu_ms.min()), peak_mb)

    def to_mapping(self) -> dict[str, Any]:
        """Return the fields as a mapping for JSON."""
        return asdict(self)


def timed(
    call: Callable[[Any], Any], items: Iterable[Any], budget_s: float, warmed: bool = False
) -> tuple[list[Any], CallTimes]:
    """Call with every item until the calls have used the budget of processor time.

    The first call is not timed, unless the kernels are `warmed` up already.

    Returns:
        the results of the calls, and their times.
    """
    gc.collect()  # so that no timed call collects garbage of earlier code
    gc.freeze()
    before = _reset_peak()
    results: list[Any] = []
    wall: list[float] = []
    cpu: list[float] = []
    for number, item in enumerate(items):
        if len(cpu) >= FEWEST and sum(cpu) > 1e3 * budget_s:
            break
        start, start_cpu = time.perf_counter(), time.process_time()
        results.append(call(item))
        end_cpu, end = time.process_time(), time.perf_counter()
        if number or warmed:
            wall.append(1e3 * (end - start))
            cpu.append(1e3 * (end_cpu - start_cpu))
    after = _memory_mb("VmHWM")
    peak = None if before is None or after is None else max(after - before, 0.0)
    if not wall:
        nan = float("nan")
        return results, CallTimes(0, nan, nan, nan, nan, nan, peak)
    return results, CallTimes.of(np.array(wall), np.array(cpu), peak)


def _reset_peak() -> float | None:
    """Reset the kernel's peak of resident memory and return the current resident set.

    Returns:
        MB; None where the kernel does not support it.
    """
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")
        return _memory_mb("VmRSS")
    return None


def _memory_mb(field: str) -> float | None:
    with suppress(OSError):
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith(field + ":"):
                return float(line.split()[1]) / 1024.0
    return None
