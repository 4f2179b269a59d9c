"""Work in a process of its own, which may break down without taking this one along."""

from __future__ import annotations

import os
import pickle
import resource
import select
import signal
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from panoptic_ros.errors import DataError, one_line

Result = TypeVar("Result")
LEAST_S, RATE = 1, 4_000_000  # s of processor time that the work may take, bytes of the file for each more
WAITING_S = 30  # s, until the work has an answer, on a busy machine
LEAST, TIMES = 512 << 20, 64  # bytes that the work may take, and times the file's size that it may take more


def apart(work: Callable[[], Result], what: str, size: int) -> Result:
    """Return what `work` returns in a child process.

    Args:
        work: reads a file with a library in C that damage brings down. Its result can be pickled.
        what: for messages. size: of the file, bytes: it bounds time and memory of the work.

    Raises:
        DataError: if the work raises anything, takes too much, or its process breaks down.
    """
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        _answer(work, reading, writing, size)
    os.close(writing)
    try:
        with os.fdopen(reading, "rb") as pipe:
            ready = select.select([pipe], [], [], WAITING_S + size / RATE)[0]
            answer = pipe.read() if ready else b""
        if not ready:
            os.kill(child, signal.SIGKILL)
    except BaseException:
        os.kill(child, signal.SIGKILL)
        raise
    finally:
        _, status = os.waitpid(child, 0)
    if status or not answer:
        raise DataError(f"{what} cannot be read: its reader breaks down, so it is damaged; copy it again")
    good, result = pickle.loads(answer)
    if not good:
        raise DataError(f"{what} cannot be read: {result}")
    found: Result = result
    return found


def _answer(work: Callable[[], object], reading: int, writing: int, size: int) -> None:
    """Do the work in the child, and end it."""
    status = 1
    try:
        os.close(reading)
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, 2)  # the library prints when it breaks down
        mapped = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        for limit, most in (
            (resource.RLIMIT_CPU, int(time.process_time()) + LEAST_S + size // RATE),
            (resource.RLIMIT_AS, mapped + LEAST + TIMES * size),
            (resource.RLIMIT_CORE, 0),
        ):
            resource.setrlimit(limit, (most, most))
        try:
            answer: tuple[bool, object] = True, work()
        except Exception as error:
            answer = False, one_line(error)
        with os.fdopen(writing, "wb") as pipe:
            pickle.dump(answer, pipe)
        status = 0
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(status)
