"""Where compiled kernels are kept, and what is said where there is no room for them."""
from __future__ import annotations

import errno
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import panoptic_ros
from panoptic_ros.errors import EnvironmentProblem


def find_room_for_kernels() -> None:
    """numba keeps compiled kernels beside their source or in the home folder, and fails without both.

    To be called before numba is imported.
    """
    places = [Path(panoptic_ros.__file__).parent, Path(os.environ.get("HOME", "/nowhere"))]
    if "NUMBA_CACHE_DIR" not in os.environ and not any(os.access(place, os.W_OK) for place in places):
        own = Path(tempfile.gettempdir()) / f"panoptic_ros-kernels-{os.getuid()}"
        os.environ["NUMBA_CACHE_DIR"] = str(own)


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
            f"{error.strerror}: make room, also where compiled kernels are kept (50 MB beside the program, "
            "in the home folder, or in NUMBA_CACHE_DIR)"
        ) from None
