"""Compiling everything ahead, in several processes, so that nothing compiles when it is needed."""

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

MOST_PROCESSES = 4  # more would mostly compile the same twice


class Warmed(NamedTuple):
    """What was done.

    Args:
        kernels: compiled now. cpu_s: processor time of it, of all processes together.
    """

    kernels: int
    cpu_s: float


def is_warm() -> bool:
    """Whether everything was compiled from these sources on this machine. Damaged files are removed."""
    return not remove_damaged(cache_folder()) and _mark().exists()


def warm_up(
    told: Callable[[float, str], None], processes: int | None = None, tasks: tuple[str, ...] = ()
) -> Warmed:
    """Compile all that any stage can need; what the cache has is only loaded.

    Args:
        told: called with the share that is done and the name of the part that was finished last.
        processes: default: as many as there are processors, at most 4.
        tasks: names of `kernel_tasks.TASKS`; default: all.

    Raises:
        ContractError: if a process that compiles broke down; its own words are on stderr.
    """
    count = processes or min(MOST_PROCESSES, len(os.sched_getaffinity(0)))
    done: list[Warmed] = []
    for total, kernels, cpu_s, name in _results(count, tasks):
        done.append(Warmed(int(kernels), float(cpu_s)))
        told(len(done) / int(total), name)
    mark = _mark()
    mark.touch()
    return Warmed(sum(part.kernels for part in done), sum(part.cpu_s for part in done))


def _results(count: int, tasks: tuple[str, ...]) -> Iterator[list[str]]:
    """What `kernel_tasks` tells of each task when it is finished."""
    command = [sys.executable, "-m", "panoptic_ros.running.compiling.kernel_tasks", str(count), *tasks]
    alone = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}  # no threads when it forks
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=alone) as process:
        assert process.stdout is not None
        for line in process.stdout:
            yield line.rstrip().split(maxsplit=3)
    if process.returncode:
        raise ContractError("a process that compiles kernels broke down; see above")


def _mark() -> Path:
    """The file that says that all is compiled."""
    return cache_folder() / f"complete-{hash_of(VERSIONS, all_sources_hash())}"
