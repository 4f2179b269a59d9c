"""Compiled kernels that build max pyramids of the score maps of all views.

Each cell of the lowest layer holds what the maps hold there, right, below, and at both: all that a bilinear
sample between these four can be. Cells of the next layer stand for 2 x 2 cells and hold what four by four
cells of the maps hold, and so on. The joints of a cell lie next to each other, 32 at a time. `masks` has two
bits for each joint of a cell: whether there is anything (from bit 0 on), and whether enough to support (from
bit 32 on). These kernels call nothing outside of this file.
"""
from __future__ import annotations

from panoptic_ros.kernels import njit

GROUP = 32  # joints in a pyramid

_jit = njit(cache=True, error_model="numpy", nogil=True)


@_jit
def build_pyramids(layers, spread, masks, grid, map_start, map_data, patch_start, patch_table, first, enough):
    """Fill empty pyramids with the merged maps of the joints first, first + 1, ...

    Args:
        layers: (V, L, 3) first cell, width and height of each layer of each view; width 0 = no more.
        spread: (N, 32) uint8; masks: (N,) int64; grid: (V, 2) width and height of maps in cells.
        map_start, map_data, patch_start, patch_table: as in `VoteScene`.
        enough: smallest value that supports.
    """
    joints = map_start.shape[1]
    for v in range(len(layers)):
        start, width = layers[v, 0, 0], layers[v, 0, 1]
        for j in range(first, min(first + GROUP, joints)):
            for k in range(patch_start[v * joints + j], patch_start[v * joints + j + 1]):
                _paint(
                    spread, masks, start, width, j - first, map_data, map_start[v, j], grid[v, 0], grid[v, 1],
                    patch_table[k, 1], patch_table[k, 2], patch_table[k, 3], patch_table[k, 4], enough,
                )  # fmt: skip
        for layer in range(1, layers.shape[1]):
            if layers[v, layer, 1] > 0:
                _halve(layers, spread, masks, v, layer)


@_jit
def _paint(
    spread, masks, start, width, joint, data, begin, columns, rows, column, row, wide, high, enough
):
    """The cells that a patch of a joint reaches, from its map of so many columns and rows."""
    here, enough_too = 1 << joint, (1 << joint) | (1 << (32 + joint))
    for y in range(max(row - 1, 0), row + high):
        above, below = begin + y * columns, begin + min(y + 1, rows - 1) * columns
        for x in range(max(column - 1, 0), column + wide):
            right = min(x + 1, columns - 1)
            value = max(max(data[above + x], data[above + right]), max(data[below + x], data[below + right]))
            if value > 0:
                spread[start + y * width + x, joint] = value
                masks[start + y * width + x] |= enough_too if value >= enough else here


@_jit
def _halve(layers, spread, masks, v, layer):
    """A layer from the one below it."""
    source, wide, high = layers[v, layer - 1]
    start, width, height = layers[v, layer]
    for y in range(height):
        above = source + 2 * y * wide
        below = source + min(2 * y + 2, high - 1) * wide
        for x in range(min(width, (wide + 1) // 2)):
            left, right = 2 * x, min(2 * x + 2, wide - 1)
            a, b, c, d = above + left, above + right, below + left, below + right
            mask = masks[a] | masks[b] | masks[c] | masks[d]
            if mask:
                cell = start + y * width + x
                masks[cell] = mask
                for j in range(GROUP):
                    upper, lower = max(spread[a, j], spread[b, j]), max(spread[c, j], spread[d, j])
                    spread[cell, j] = max(upper, lower)


@_jit
def clear_pyramids(spread, masks):
    """Empty what `build_pyramids` has filled; less work than new memory."""
    for cell in range(len(masks)):
        if masks[cell]:
            masks[cell] = 0
            spread[cell] = 0
