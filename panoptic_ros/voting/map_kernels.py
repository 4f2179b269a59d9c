"""Compiled kernels on score maps; arguments as in `VoteScene`, grid (V, 2) is the maps' size in cells.

They call nothing outside of this file.
"""
from __future__ import annotations

import numpy as np
from numba import njit

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


@_jit
def count_map_peaks(
    map_start, map_data, grid, patch_start, patch_table, patch_data, threshold, counts, cells
):
    """3x3 local maxima above a threshold of all merged maps.

    Writes how many there are into counts (V * J) and, if cells (K, 2) is long enough, their columns
    and rows, in the order of view, joint, patch, row. Equal neighbours: the first one is the peak. Of
    patches that lie on each other the first with the largest value has the peak. Reads the maps only
    where a patch may have one: patches lie close together in memory, their places in the maps do not.
    """
    joints = map_start.shape[1]
    total, least = 0, 255.0 * threshold
    for v in range(map_start.shape[0]):
        width, height = grid[v, 0], grid[v, 1]
        for j in range(joints):
            start = map_start[v, j]
            counts[v * joints + j] = 0
            if start < 0:
                continue
            first, last = patch_start[v * joints + j], patch_start[v * joints + j + 1]
            for k in range(first, last):
                column, row, w, h, begin = patch_table[k, 1:]
                for at in range(begin, begin + w * h):
                    value = patch_data[at]
                    if value <= least:
                        continue
                    y = (at - begin) // w
                    x = at - begin - y * w
                    if (x > 0 and patch_data[at - 1] >= value) or (y > 0 and patch_data[at - w] >= value):
                        continue
                    if (x < w - 1 and patch_data[at + 1] > value) or (
                        y < h - 1 and patch_data[at + w] > value
                    ):
                        continue
                    x, y = x + column, y + row
                    if map_data[start + y * width + x] != value:
                        continue  # another patch lies higher
                    if not _is_peak(map_data, start, width, height, x, y):
                        continue
                    if _in_earlier_patch(patch_table, patch_data, first, k, x, y, value):
                        continue
                    if total < len(cells):
                        cells[total, 0], cells[total, 1] = x, y
                    counts[v * joints + j] += 1
                    total += 1
    return total


@_jit
def _in_earlier_patch(patch_table, patch_data, first, k, x, y, value):
    for other in range(first, k):
        column, row, w, h, begin = patch_table[other, 1:]
        if column <= x < column + w and row <= y < row + h:
            if patch_data[begin + (y - row) * w + x - column] == value:
                return True
    return False


@_jit
def _is_peak(map_data, start, width, height, x, y):
    value = map_data[start + y * width + x]
    for b in range(max(y - 1, 0), min(y + 2, height)):
        for a in range(max(x - 1, 0), min(x + 2, width)):
            other = map_data[start + b * width + a]
            earlier = b < y or (b == y and a < x)
            if other > value or (earlier and other == value):
                return False
    return True


@_jit
def peak_centroids(map_start, map_data, grid, counts, cells):
    """Centroids (K, 2) in cells of the 3x3 windows round peaks, weighted by the square of the score."""
    joints = map_start.shape[1]
    places = np.zeros((len(cells), 2))
    n = 0
    for key in range(len(counts)):
        v, j = key // joints, key % joints
        start, width, height = map_start[v, j], grid[v, 0], grid[v, 1]
        for _ in range(counts[key]):
            x, y = cells[n]
            total, sum_x, sum_y = 0.0, 0.0, 0.0
            for b in range(max(y - 1, 0), min(y + 2, height)):
                for a in range(max(x - 1, 0), min(x + 2, width)):
                    weight = float(map_data[start + b * width + a]) ** 2
                    total += weight
                    sum_x += weight * a
                    sum_y += weight * b
            places[n, 0], places[n, 1] = sum_x / total, sum_y / total
            n += 1
    return places
