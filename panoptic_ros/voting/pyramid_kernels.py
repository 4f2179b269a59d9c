"""Compiled kernels that build max pyramids of the score maps of all views.

A pyramid holds the joints of a cell next to each other, 32 at a time. They call nothing outside of this file.
"""
from __future__ import annotations

from numba import njit

GROUP = 32  # joints in a pyramid

_jit = njit(cache=True, error_model="numpy", nogil=True)


@_jit
def paint_pyramids(layers, values, filled, patch_start, patch_table, patch_data, joints, first):
    """Fill empty pyramids with the merged maps of the joints first, first + 1, ...

    Args:
        layers: (V, L, 3) first cell, width and height of each layer of each view; width 0 = no more.
        values: (N, 32) uint8; filled: (N,) bool, whether there is anything.
        patch_start, patch_table, patch_data: as in `VoteScene`, which has so many `joints`.
    """
    last = min(first + GROUP, joints)
    for v in range(len(layers)):
        start, width = layers[v, 0, 0], layers[v, 0, 1]
        for j in range(first, last):
            for k in range(patch_start[v * joints + j], patch_start[v * joints + j + 1]):
                column, row, w, h, at = patch_table[k, 1:]
                for y in range(h):
                    for x in range(w):
                        value = patch_data[at + y * w + x]
                        if value > 0:
                            cell = start + (row + y) * width + column + x
                            values[cell, j - first] = max(values[cell, j - first], value)
                            filled[cell] = True
        for layer in range(1, layers.shape[1]):
            if layers[v, layer, 1] > 0:
                _halve(layers, values, filled, v, layer)


@_jit
def _halve(layers, values, filled, v, layer):
    """A layer from the one below it; each cell holds what up to 2 x 2 cells there hold."""
    below, wide, high = layers[v, layer - 1]
    start, width, _ = layers[v, layer]
    for y in range(high):
        for x in range(wide):
            source = below + y * wide + x
            if not filled[source]:
                continue
            target = start + (y >> 1) * width + (x >> 1)
            filled[target] = True
            for j in range(GROUP):
                values[target, j] = max(values[target, j], values[source, j])


@_jit
def spread_pyramids(layers, values, filled, spread, reached):
    """Fill empty `spread` (N, 32) with the largest of a cell and those right, below, and both.

    Marks in `reached` (N,) bool where there is anything.
    """
    for v in range(len(layers)):
        for layer in range(layers.shape[1]):
            start, width, height = layers[v, layer]
            for y in range(height):
                for x in range(width):
                    cell = start + y * width + x
                    if not filled[cell]:
                        continue
                    for step in range(4):
                        if x >= step & 1 and y >= step >> 1:
                            target = cell - (step & 1) - (step >> 1) * width
                            reached[target] = True
                            for j in range(GROUP):
                                spread[target, j] = max(spread[target, j], values[cell, j])


@_jit
def clear_pyramids(values, filled, spread, reached):
    """Empty what the other kernels have filled; less work than new memory."""
    for cell in range(len(reached)):
        if reached[cell]:
            filled[cell] = reached[cell] = False
            values[cell] = 0
            spread[cell] = 0
