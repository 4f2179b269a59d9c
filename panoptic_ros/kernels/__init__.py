"""Compiled functions: numba's `njit` with a cache that never holds stale code.

Every module with compiled functions takes `njit` from here. The cache is named by the contents of all
sources that such a module can reach, so it does not matter where the package is installed, and no edit,
`git pull` or colcon workspace runs what was compiled from other sources. This room reads sources and the
environment, which the other rooms of its rank may not: that is its task, and no result depends on it.
"""

from panoptic_ros.kernels.cache import cache_folder, damaged_files, remove_damaged
from panoptic_ros.kernels.jit import inlined, njit, on_compilation
from panoptic_ros.kernels.sources import all_sources_hash

__all__ = [
    "all_sources_hash",
    "cache_folder",
    "damaged_files",
    "inlined",
    "njit",
    "on_compilation",
    "remove_damaged",
]
