"""Compiled kernel that merges score maps. Arguments as in `VoteScene`; grid (V, 2): their sizes in cells."""
from __future__ import annotations

from panoptic_ros.kernels import njit

_jit = njit(cache=True, error_model="numpy", nogil=True)


@_jit
def paint_maps(map_start, map_data, grid, patch_start, patch_table, patch_data):
    """Merge the patches of every (view, joint) into its map, in place: the largest value counts."""
    joints = map_start.shape[1]
    for v in range(map_start.shape[0]):
        for j in range(joints):
            start = map_start[v, j]
            if start < 0:
                continue
            for k in range(patch_start[v * joints + j], patch_start[v * joints + j + 1]):
                column, row, width, height, first = patch_table[k, 1:]
                for y in range(height):
                    for x in range(width):
                        at = start + (row + y) * grid[v, 0] + column + x
                        map_data[at] = max(map_data[at], patch_data[first + y * width + x])

