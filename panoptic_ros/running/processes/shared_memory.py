"""Removes shared-memory segments of killed Fast DDS processes, and reports a full /dev/shm.

A process holds a lock on `<segment>_el` in /dev/shm as long as it lives. A segment without that lock belongs
to a process that was killed. `fastdds shm clean` uses the same criterion.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import time
from contextlib import suppress
from pathlib import Path

from panoptic_ros.errors import EnvironmentProblem

SHARED_MEMORY = Path("/dev/shm")
# bytes; without free memory, the first write of a process ends it by a bus error (SIGBUS)
LEAST_FREE = 1_000_000
YOUNG_S = 5.0  # s; a younger segment may belong to a process that has not taken its lock yet
LOCK = "_el"
SEGMENTS = ("fastrtps_*", "fastdds_*")  # segment names of Fast DDS 2 and 3


def prepare_shared_memory(folder: Path = SHARED_MEMORY) -> int:
    """Remove segments of this user's killed processes, then check that enough memory is free.

    Returns:
        the number of freed bytes.

    Raises:
        EnvironmentProblem: if less than `LEAST_FREE` is free.
    """
    freed = remove_leftovers(folder)
    with suppress(FileNotFoundError):  # without /dev/shm, messages go over UDP
        usage = shutil.disk_usage(folder)
        if usage.free < LEAST_FREE:
            raise EnvironmentProblem(full(folder))
    return freed


def full(folder: Path = SHARED_MEMORY) -> str:
    """Return the error message about a full shared memory. It names the largest file."""
    usage = shutil.disk_usage(folder)
    largest = ""
    with suppress(OSError, ValueError):
        path = max(folder.iterdir(), key=lambda path: path.stat().st_size)
        largest = f", {path.stat().st_size >> 20} MiB of it {path.name}"
    return (
        f"{folder}, over which ROS processes talk, is full ({usage.free >> 10} KiB of {usage.total >> 20} "
        f"MiB free{largest}): remove files there that no process needs, or give the container --shm-size=1g"
    )


def leftovers(folder: Path = SHARED_MEMORY) -> list[Path]:
    """Return the files of this user's segments whose process was killed."""
    found: list[Path] = []
    for lock in (path for pattern in SEGMENTS for path in folder.glob(pattern + LOCK)):
        if _is_left(lock):
            segment = lock.with_name(lock.name.removesuffix(LOCK))
            shared = segment.with_name(f"{segment.name}_sl")
            beside = (segment, folder / f"sem.{segment.name}_mutex", shared, lock)
            found += [path for path in beside if path.exists()]
    return found


def remove_leftovers(folder: Path = SHARED_MEMORY) -> int:
    """Remove the files of `leftovers`; return the number of freed bytes."""
    freed = 0
    for path in leftovers(folder):
        with suppress(OSError):
            size = path.stat().st_size
            path.unlink()
            freed += size
    return freed


def _is_left(lock: Path) -> bool:
    try:
        status = lock.stat()
        if status.st_uid != os.getuid() or time.time() - status.st_mtime < YOUNG_S:
            return False
        descriptor = os.open(lock, os.O_RDWR | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:  # its process is alive
        return False
    finally:
        os.close(descriptor)
    return True
