"""Compiling everything ahead, in several processes, so that nothing compiles when it is needed."""
from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import NamedTuple

from panoptic_ros.errors import ContractError
from panoptic_ros.kernels import all_sources_hash, cache_folder
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
    """Whether everything was compiled from these sources on this machine."""
    return _mark().exists()


def warm_up(told: Callable[[float, str], None], processes: int | None = None) -> Warmed:
    """Compile all that any stage can need; what the cache has is only loaded.

    Args:
        told: called with the share that is done and the name of the part that was finished last.
        processes: default: as many as there are processors, at most 4.

    Raises:
        ContractError: if a process that compiles broke down; its own words are on stderr.
    """
    from panoptic_ros.running.kernel_tasks import TASKS  # loads all stages

    waiting: SimpleQueue[str] = SimpleQueue()
    for name in TASKS:
        waiting.put(name)
    done: list[Warmed] = []

    def finished(name: str, result: Warmed) -> None:
        done.append(result)
        told(len(done) / len(TASKS), name)

    count = processes or min(MOST_PROCESSES, len(os.sched_getaffinity(0)))
    with ThreadPoolExecutor(count) as pool:
        for future in [pool.submit(_work_off, waiting, finished) for _ in range(count)]:
            future.result()
    mark = _mark()
    mark.touch()
    return Warmed(sum(part.kernels for part in done), sum(part.cpu_s for part in done))


def _mark() -> Path:
    """The file that says that all is compiled."""
    return cache_folder() / f"complete-{hash_of(VERSIONS, all_sources_hash())}"


def _work_off(waiting: SimpleQueue[str], finished: Callable[[str, Warmed], None]) -> None:
    """Let one process compile parts until none is left."""
    command = [sys.executable, "-m", "panoptic_ros.running.kernel_tasks"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdin is not None and process.stdout is not None
        try:
            while True:
                name = waiting.get_nowait()
                process.stdin.write(f"{name}\n")
                process.stdin.flush()
                answer = process.stdout.readline().split()
                if len(answer) != 2:
                    raise ContractError(f"compiling {name} broke down; see above")
                finished(name, Warmed(int(answer[1]), float(answer[0])))
        except Empty:
            process.stdin.close()
        except BaseException:
            process.kill()
            raise
