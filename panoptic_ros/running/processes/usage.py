"""Measures the processor time and memory of processes from Linux's /proc."""

from __future__ import annotations

import os
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from panoptic_ros.errors import EnvironmentProblem


@dataclass(frozen=True)
class Usage:
    """Resources that processes have used so far.

    Args:
        at_ns: time of the measurement on the monotonic clock, ns.
        cpu_s: processor time since their start, s.
        resident_mb: resident memory now, MB.
    """

    at_ns: int
    cpu_s: float
    resident_mb: float


def usage_of(processes: Iterable[int]) -> Usage:
    """Return the total processor time and resident memory of processes.

    The processor time counts all threads, in user and in kernel mode.

    Args:
        processes: process ids.

    Raises:
        EnvironmentProblem: if a process does not run, or there is no /proc.
    """
    rows = [_fields(process) for process in processes]
    cpu_s = sum(user + system for user, system, _ in rows) / os.sysconf("SC_CLK_TCK")
    pages = sum(resident for _, _, resident in rows)
    return Usage(time.monotonic_ns(), cpu_s, 1e-6 * pages * os.sysconf("SC_PAGE_SIZE"))


def _fields(process: int) -> tuple[int, int, int]:
    """Return utime and stime (ticks) and resident memory (pages) of a process; see proc_pid_stat(5)."""
    path = Path(f"/proc/{process}/stat")
    try:
        text = path.read_text()
    except OSError as error:
        raise EnvironmentProblem(
            f"{path}, the file of processor times, cannot be read ({error.strerror}); run it on Linux"
        ) from None
    # fields from the third on; the process name before them may contain any character
    fields = text.rpartition(")")[2].split()
    return int(fields[11]), int(fields[12]), int(fields[21])
