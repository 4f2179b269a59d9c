"""Programs with kernels in processes that `fork_server` forks, which have numba and its compiler already."""

import os
import sys

import numba


def load():
    """Let the compiler load what it needs."""
    numba.njit(lambda x: 2.0 * x)(1.0)


def begin(program, folder):
    """Run the text of a program with the package in a folder; kernels go where NUMBA_CACHE_DIR says."""
    assert not any(name.partition(".")[0] == "panoptic_ros" for name in sys.modules)
    numba.config.reload_config()
    sys.dont_write_bytecode = True  # Python's own files go by the time of a source, which a test keeps
    sys.path.insert(0, folder)
    os.chdir(folder)
    exec(program, {"__name__": "__main__"})
