"""Times and memory of calls, first call excluded."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

FEWEST = 1  # timed calls, whatever the budget


@dataclass(frozen=True)
class Times:
    """Milliseconds per call: wall time, and processor time of this process."""

    calls: int
    wall_ms_median: float
    wall_ms_p99: float
    cpu_ms_median: float
    cpu_ms_p99: float
    cpu_ms_least: float
    peak_mb: float | None  # growth of the resident set while they ran; None = not known here

    @classmethod
    def of(cls, wall_ms: np.ndarray, cpu_ms: np.ndarray, peak_mb: float | None) -> Times:
        """Of single calls (N,)."""
        wall, cpu = (np.percentile(row, [50, 99]).tolist() for row in (wall_ms, cpu_ms))
        return cls(len(wall_ms), wall[0], wall[1], cpu[0], cpu[1], float(cpu_ms.min()), peak_mb)

    def to_mapping(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


def timed(
    call: Callable[[Any], Any], items: Iterable[Any], budget_s: float, warmed: bool = False
) -> tuple[list[Any], Times]:
    """Call with every item until the budget of processor time is used up.

    The first call is not timed, unless the kernels are `warmed` up already.

    Returns:
        what the calls gave, and their times.
    """
    gc.collect()  # so that no call waits for what earlier ones left
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
        return results, Times(0, nan, nan, nan, nan, nan, peak)
    return results, Times.of(np.array(wall), np.array(cpu), peak)


def _reset_peak() -> float | None:
    """Let the kernel forget the peak of memory; the resident set now, MB. None where it cannot."""
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
