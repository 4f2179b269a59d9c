"""Compiled functions: numba's `njit` with a cache that never returns stale code.

Every module with compiled functions imports `njit` from here. The name of a cache folder is a hash of all
sources that its module can import. So the install location does not matter, and an edit, a `git pull` or
another colcon workspace never runs code compiled from other sources. This package reads sources and the
environment, which other packages of its layer may not. No result depends on them.
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
