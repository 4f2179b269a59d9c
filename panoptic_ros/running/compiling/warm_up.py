"""Compiles all kernels ahead of time in several processes, so that no run has to compile."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from panoptic_ros.errors import ContractError
from panoptic_ros.kernels import all_sources_hash, cache_folder, remove_damaged
from panoptic_ros.kernels.cache import VERSIONS, hash_of

MOST_PROCESSES = 4  # more processes would mostly compile the same kernels twice


class WarmUpResult(NamedTuple):
    """Result of a warm-up.

    Args:
        kernels: number of kernels that were compiled now.
        cpu_s: total processor time of all processes, s.
    """

    kernels: int
    cpu_s: float


def is_warm() -> bool:
    """Return whether all kernels are compiled for these sources on this machine.

    Damaged cache files are removed.
    """
    return not remove_damaged(cache_folder()) and _mark().exists()


def warm_up(
    told: Callable[[float, str], None], processes: int | None = None, tasks: tuple[str, ...] = ()
) -> WarmUpResult:
    """Compile all kernels that any stage can need. Cached kernels are only loaded.

    Args:
        told: callback with the completed share, 0..1, and the name of the finished task.
        processes: number of processes. The default is the number of processors, at most `MOST_PROCESSES`.
        tasks: names of `kernel_tasks.TASKS`; default: all.

    Raises:
        ContractError: if a compiling process failed. Its own error message is on stderr.
    """
    count = processes or min(MOST_PROCESSES, len(os.sched_getaffinity(0)))
    done: list[WarmUpResult] = []
    for total, kernels, cpu_s, name in _results(count, tasks):
        done.append(WarmUpResult(int(kernels), float(cpu_s)))
        told(len(done) / int(total), name)
    mark = _mark()
    mark.touch()
    return WarmUpResult(sum(part.kernels for part in done), sum(part.cpu_s for part in done))


def _results(count: int, tasks: tuple[str, ...]) -> Iterator[list[str]]:
    """Yield the output line of every finished task of `kernel_tasks`, split into its four words."""
    command = [sys.executable, "-m", "panoptic_ros.running.compiling.kernel_tasks", str(count), *tasks]
    # no BLAS or OpenMP threads may exist at the fork
    alone = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=alone) as process:
        assert process.stdout is not None
        for line in process.stdout:
            yield line.rstrip().split(maxsplit=3)
    if process.returncode:
        raise ContractError("a process that compiles kernels broke down; see above")


def _mark() -> Path:
    """Return the path of the marker file that exists when all kernels are compiled."""
    return cache_folder() / f"complete-{hash_of(VERSIONS, all_sources_hash())}"
