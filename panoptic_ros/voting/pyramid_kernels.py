"""Compiled kernels that build max pyramids of the score maps of all views.

Each cell of the lowest layer holds what the maps hold there, right, below, and at both: all that a bilinear
sample between these four can be. Cells of the next layer stand for 2 x 2 cells and hold what four by four
cells of the maps hold, and so on. The joints of a cell lie next to each other, 32 at a time. `masks` has two
bits for each joint of a cell: whether there is anything (from bit 0 on), and whether enough to support (from
bit 32 on).
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.kernels import inlined, njit

Array = np.ndarray
GROUP = 32  # joints in a pyramid

_jit = njit(cache=True, error_model="numpy", nogil=True)


class Pyramids(NamedTuple):
    """The pyramids of all views.

    layers: (V, L, 3) first cell, width and height of each layer of each view; width 0 = no more.
    spread: (N, 32) uint8, what a cell holds of each joint. masks: (N,) int64.
    """

    layers: Array
    spread: Array
    masks: Array


@_jit
def build_pyramids(scene, pyramids, first, supporting):
    """Fill empty pyramids with the merged maps of the joints first, first + 1, ... of a `VoteScene`.

    supporting: smallest value that supports.
    """
    layers, joints = pyramids.layers, scene.map_start.shape[1]
    for v in range(len(layers)):
        for joint in range(first, min(first + GROUP, joints)):
            for k in range(scene.patch_start[v * joints + joint], scene.patch_start[v * joints + joint + 1]):
                _paint(scene, pyramids, v, joint, k, 1 << (joint - first), supporting)
        for layer in range(1, layers.shape[1]):
            if layers[v, layer, 1] > 0:
                _halve(pyramids, v, layer)


@inlined
def _paint(scene, pyramids, v, joint, k, bit, supporting):
    """The cells that patch k of a joint reaches, from its map; bit: of the joint."""
    data, table, spread, masks = scene.map_data, scene.patch_table, pyramids.spread, pyramids.masks
    columns, rows = int(scene.cameras[v].columns), int(scene.cameras[v].rows)
    begin, start, width = scene.map_start[v, joint], pyramids.layers[v, 0, 0], pyramids.layers[v, 0, 1]
    row = table[k, 2]
    for y in range(max(row - 1, 0), row + table[k, 4]):
        above, below = begin + y * columns, begin + min(y + 1, rows - 1) * columns
        for x in range(max(table[k, 1] - 1, 0), table[k, 1] + table[k, 3]):
            right = min(x + 1, columns - 1)
            value = max(max(data[above + x], data[above + right]), max(data[below + x], data[below + right]))
            if value > 0:
                spread[start + y * width + x, joint % GROUP] = value
                masks[start + y * width + x] |= bit | bit << GROUP if value >= supporting else bit


@inlined
def _halve(pyramids, v, layer):
    """A layer from the one below it."""
    layers, spread, masks = pyramids
    source, wide, high = layers[v, layer - 1, 0], layers[v, layer - 1, 1], layers[v, layer - 1, 2]
    start, width, height = layers[v, layer, 0], layers[v, layer, 1], layers[v, layer, 2]
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
