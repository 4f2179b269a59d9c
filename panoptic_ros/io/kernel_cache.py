"""Turn a full disk or an invalid path into a one-line error, for any library that meets it."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager

from panoptic_ros.errors import EnvironmentProblem, shown

# Name longer than 255 bytes, circular links, read-only disk, file or folder without permission.
BAD_PATH = (errno.ENAMETOOLONG, errno.ELOOP, errno.EROFS, errno.EACCES, errno.EPERM)


@contextmanager
def full_disk_told() -> Iterator[None]:
    """Turn a full-disk error of a library into a one-line error, e.g. when numba caches a kernel.

    Raises:
        EnvironmentProblem: instead of the operating system's error.
    """
    try:
        yield
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        raise EnvironmentProblem(
            f"{error.strerror}: make room, also for compiled kernels (50 MB in the user's cache, or in "
            "NUMBA_CACHE_DIR)"
        ) from None


@contextmanager
def bad_path_told() -> Iterator[None]:
    """Turn the operating system's error about an invalid path into a one-line error.

    Raises:
        EnvironmentProblem: instead of the operating system's error.
    """
    try:
        yield
    except OSError as error:
        if error.errno not in BAD_PATH or error.filename is None:
            raise
        path = shown(str(error.filename))
        raise EnvironmentProblem(f"{path}: {error.strerror}; name another path") from None
