"""What processes use, as Linux tells it."""

from __future__ import annotations

import os
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from panoptic_ros.errors import EnvironmentProblem


@dataclass(frozen=True)
class Usage:
    """What processes have used so far: a moment, their processor time, and their memory now."""

    at_ns: int
    cpu_s: float
    resident_mb: float


def usage_of(processes: Iterable[int]) -> Usage:
    """The processor time of all threads of these processes, in their own code and in the system's, and
    their resident memory together.

    Args:
        processes: ids.

    Raises:
        EnvironmentProblem: if one does not run, or there is no /proc.
    """
    rows = [_fields(process) for process in processes]
    cpu_s = sum(user + system for user, system, _ in rows) / os.sysconf("SC_CLK_TCK")
    pages = sum(resident for _, _, resident in rows)
    return Usage(time.monotonic_ns(), cpu_s, 1e-6 * pages * os.sysconf("SC_PAGE_SIZE"))


def _fields(process: int) -> tuple[int, int, int]:
    """utime, stime (ticks) and resident pages; see proc_pid_stat(5)."""
    path = Path(f"/proc/{process}/stat")
    try:
        text = path.read_text()
    except OSError as error:
        raise EnvironmentProblem(
            f"{path} cannot be read ({error.strerror}), which tells processor time; run it on Linux"
        ) from None
    fields = text.rpartition(")")[2].split()  # from the third on: the name before may hold anything
    return int(fields[11]), int(fields[12]), int(fields[21])
