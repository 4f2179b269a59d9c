"""What is said where there is no room for compiled kernels."""
from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager

from panoptic_ros.errors import EnvironmentProblem


@contextmanager
def full_disk_told() -> Iterator[None]:
    """Turn a full disk that a library meets into one clear line, e.g. numba when it keeps a kernel.

    Raises:
        EnvironmentProblem: in place of the operating system's error.
    """
    try:
        yield
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        raise EnvironmentProblem(
            f"{error.strerror}: make room, also where compiled kernels are kept (50 MB in the user's "
            "cache, or where NUMBA_CACHE_DIR says)"
        ) from None
