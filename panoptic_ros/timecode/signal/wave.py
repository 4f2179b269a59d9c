"""The wave of a word: its edges, and its samples with their derivatives.

A word's wave is a sum of steps, that is of signs and, near each edge, of a table (2, P + 1, 2 R): what a step
has more than its sign, and its slope, at R samples to both sides and P places between two samples. Entry
(p, j) is for a sample that lies j - R + p / P after the edge.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.timecode.signal.grid import Grid

Array = np.ndarray
_jit = njit(cache=True, error_model="numpy", nogil=True)


class Samples(NamedTuple):
    """Samples (N,) as recorded, and the index of the first since the stream's start."""

    first: int
    values: Array


class Edges(NamedTuple):
    """The edges of a word, in cells from the middle of a grid; the wave rises at the first."""

    grid: Grid
    places: Array


@_jit
def edge_places(bits: Array) -> Array:
    """Edges of a word (N,) in cells from its middle, the one that ends it included."""
    count, half = 0, 0.5 * len(bits)
    places = np.empty(2 * len(bits) + 1)
    for k in range(len(bits)):
        places[count] = k - half
        count += 1
        if bits[k]:
            places[count] = k + 0.5 - half
            count += 1
    places[count] = half
    return places[: count + 1].copy()


@_jit
def train_rows(samples: Samples, edges: Edges, shape: Array) -> Array:
    """A word's wave, that times time, its derivatives by middle and cell, the samples, (5, N).

    Args:
        shape: (2, P + 1, 2 R) see above.
    """
    values, places = samples.values, edges.places
    count = len(values)
    phases, reach = shape.shape[1] - 1, shape.shape[2] // 2
    rows = np.zeros((5, count))
    middle, cell = edges.grid
    sign, begin = -1.0, 0
    for k in range(len(places)):
        u = places[k]
        edge = middle + cell * u - samples.first
        after = int(np.ceil(edge))
        end = min(max(after, 0), count)
        for i in range(begin, end):
            rows[0, i] += sign
        begin, sign = end, -sign
        place = (after - edge) * phases
        below = min(int(place), phases - 1)
        part = place - below
        first = after - reach
        for j in range(max(0, -first), min(2 * reach, count - first)):
            i = first + j
            more = shape[0, below, j] * (1.0 - part) + shape[0, below + 1, j] * part
            slope = -sign * (shape[1, below, j] * (1.0 - part) + shape[1, below + 1, j] * part)
            rows[0, i] += sign * more
            rows[2, i] += slope
            rows[3, i] += slope * u
    for i in range(begin, count):
        rows[0, i] += sign
    scale = 2.0 / (count - 1.0)
    for i in range(count):
        rows[1, i] = rows[0, i] * (scale * i - 1.0)
        rows[4, i] = values[i]
    return rows
