"""One line about a full disk or an impossible path, whichever library meets it."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager

from panoptic_ros.errors import EnvironmentProblem, shown

# a name of more than 255 bytes, links in a circle, a disk that is read-only, a folder or file of others
BAD_PATH = (errno.ENAMETOOLONG, errno.ELOOP, errno.EROFS, errno.EACCES, errno.EPERM)


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


@contextmanager
def bad_path_told() -> Iterator[None]:
    """Turn what the operating system says of an impossible path into one clear line.

    Raises:
        EnvironmentProblem: in place of its error.
    """
    try:
        yield
    except OSError as error:
        if error.errno not in BAD_PATH or error.filename is None:
            raise
        path = shown(str(error.filename))
        raise EnvironmentProblem(f"{path}: {error.strerror}; name another path") from None
