"""The loops of learning the shape of a step."""

from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.timecode.signal.wave import Edges

Array = np.ndarray
OWN, PLACE = 5, 3  # unknowns of each word alone: level, level times time and time squared, place, length
_jit = njit(cache=True, error_model="numpy", nogil=True)


@_jit
def integrated(values: Array) -> Array:
    """Integral (N,) of samples without their mean, by trapezia."""
    mean, total = values.mean(), 0.0
    out = np.empty(len(values))
    for i in range(len(values)):
        even = values[i] - mean
        out[i] = total + 0.5 * even
        total += even
    return out


@_jit
def shape_rows(
    train: Array, level: float, first_sample: int, edges: Edges, splines: Array, knot: float
) -> Array:
    """Design matrix of a word, (`OWN` + J + 2, N).

    Rows: the unknowns of the word alone, the splines of the shape, the droop, the samples; levels are 1.

    Args:
        train: (5, N) the word's `train_rows`.
        level: of the word, signed.
        splines: (J, 2, P + 1, 2 R) cubic, tables as in `wave`.
        knot: samples by which each begins after the one before.
    """
    count, functions = train.shape[1], len(splines)
    phases, reach = splines.shape[2] - 1, splines.shape[3] // 2
    rows = np.zeros((OWN + functions + 2, count))
    droop, whole = OWN + functions, OWN + functions + 1
    for i in range(count):
        rows[0, i], rows[1, i], rows[3, i], rows[4, i] = train[0, i], train[1, i], train[2, i], train[3, i]
        rows[2, i] = train[1, i] * (2.0 * i / (count - 1.0) - 1.0)
        rows[whole, i] = train[4, i] / level
    integral = integrated(rows[whole])
    for i in range(count):
        rows[droop, i] = -integral[i]
    middle, cell = edges.grid
    places = edges.places
    sign = 1.0
    for k in range(len(places)):
        u = places[k]
        edge = middle + cell * u - first_sample
        after = int(np.ceil(edge))
        place = (after - edge) * phases
        below = min(int(place), phases - 1)
        part = place - below
        first = after - reach
        for j in range(max(0, -first), min(2 * reach, count - first)):
            last = min(int((j + place / phases) / knot), functions - 1)
            for s in range(max(0, last - 3), last + 1):
                value = splines[s, 0, below, j] * (1.0 - part) + splines[s, 0, below + 1, j] * part
                rows[OWN + s, first + j] += sign * value
        sign = -sign
    return rows


@_jit
def without_own(gram: Array) -> Array:
    """Gram matrix (I, I) of a word's rows with its own unknowns eliminated, (I - `OWN`, I - `OWN`)."""
    rest = gram.copy()
    for k in range(OWN):
        for i in range(k + 1, len(rest)):
            factor = rest[i, k] / rest[k, k]
            for j in range(k + 1, len(rest)):
                rest[i, j] -= factor * rest[k, j]
    return rest[OWN:, OWN:].copy()


@_jit
def corrected(guess: Array, splines: Array, weights: Array) -> Array:
    """The table (2, P + 1, 2 R) of a step: a guess and weighted splines, see `shape_rows`."""
    table = guess.copy()
    for s in range(len(splines)):
        for row in range(2):
            for p in range(table.shape[1]):
                for j in range(table.shape[2]):
                    table[row, p, j] += weights[s] * splines[s, row, p, j]
    return table
