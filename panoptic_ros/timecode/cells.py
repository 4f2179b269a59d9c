"""From samples to bits: half-cell integrals and a two-state Viterbi search over them."""
from __future__ import annotations

import numpy as np

Array = np.ndarray


def integrate(cumulative: Array, positions: Array) -> Array:
    """Integral from the first sample to fractional positions (...), between samples by interpolation.

    Args:
        cumulative: (N + 1,) sums of samples, 0 first; sample i covers i - 0.5 to i + 0.5.
        positions: in samples.
    """
    place = np.clip(positions + 0.5, 0.0, len(cumulative) - 1.001)
    below = place.astype(np.int64)
    part = place - below
    return cumulative[below] * (1.0 - part) + cumulative[below + 1] * part


def half_cells(cumulative: Array, start: float, cell: float, count: int) -> Array:
    """Mean level (2 * count,) of the half cells of `count` cells from `start` on."""
    bounds = start + 0.5 * cell * np.arange(2 * count + 1)
    return np.diff(integrate(cumulative, bounds)) / (0.5 * cell)


def decide_bits(halves: Array) -> tuple[Array, float]:
    """The most likely bits (N,) of half-cell levels (2 N,) and how well they explain the levels.

    At every cell's start the level changes sign, in the middle of a one it does so again: the
    state is the sign of the first half. The quality is the sum of the levels with the signs found over
    the sum of their magnitudes: 1 = all fits.
    """
    same, change = halves[0::2] + halves[1::2], halves[0::2] - halves[1::2]
    count = len(same)
    came_from = np.empty((count, 2), np.int8)
    plus, minus = 0.0, 0.0  # best score with this cell's first half positive, negative
    for k, (zero, one) in enumerate(zip(same.tolist(), change.tolist())):
        # A zero hands on the opposite sign, a one (two changes) the same.
        to_minus, to_plus = plus + zero, plus + one
        other_plus, other_minus = minus - zero, minus - one
        came_from[k] = (other_plus > to_plus, to_minus > other_minus)
        plus, minus = max(to_plus, other_plus), max(to_minus, other_minus)
    bits = np.empty(count, np.int8)
    state = 0 if plus >= minus else 1  # sign of the half after the last cell
    for k in range(count - 1, -1, -1):
        crossed = came_from[k, state]
        bits[k] = not crossed
        state = 1 - state if crossed else state
    total = float(np.abs(halves).sum())
    return bits, max(plus, minus) / total if total > 0.0 else 0.0


def even_parity(halves: Array) -> bool:
    """Whether cells begin at even half cells: their levels always change sign between cells."""
    product = halves[:-1] * halves[1:]
    return float(product[1::2].sum()) <= float(product[0::2].sum())
