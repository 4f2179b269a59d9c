"""The loops over samples and half cells, compiled. All that call each other are in one file, since
numba's cache watches only the file of the function that is called.

A grid of cells is (middle, cell, bend): cell u from the middle begins at middle + cell * (u + bend * u^2).
"""
from __future__ import annotations

from functools import lru_cache

import numpy as np
from numba import njit

Array = np.ndarray
_jit = njit(cache=True, error_model="numpy", nogil=True)
FREE = -1  # a bit that is not known
LEAST_NOISE = 0.35  # of the level: what noise-free recordings have from echoes and filters


@_jit
def integral(sums: Array, position: float) -> float:
    """Integral up to a fractional position; sample i covers i - 0.5 to i + 0.5."""
    place = min(max(position + 0.5, 0.0), len(sums) - 1.001)
    below = int(place)
    part = place - below
    return sums[below] * (1.0 - part) + sums[below + 1] * part


@_jit
def half_levels(sums: Array, middle: float, cell: float, bend: float, first: float, count: int) -> Array:
    """Mean levels (2 * count,) of the half cells of `count` cells from cell `first` of a grid on."""
    levels = np.empty(2 * count)
    before, value = 0.0, 0.0
    for k in range(2 * count + 1):
        u = first + 0.5 * k
        place = middle + cell * (u + bend * u * u)
        now = integral(sums, place)
        if k > 0:
            levels[k - 1] = (now - value) / (place - before)
        before, value = place, now
    return levels


@_jit
def energy(sums: Array, start: float, half: float, bend: float, count: int) -> float:
    """Sum of squared integrals over `count` half cells from a place on, each longer than the last by `bend`.

    All that lies outside counts nothing.
    """
    step, total, last = half, 0.0, len(sums) - 1.001
    place, k = start + 0.5, 0
    while place < 0.0 and k < count:
        place += step
        step += bend
        k += 1
    if not 0.0 <= place <= last:
        return 0.0
    below = int(place)
    value = sums[below] + (sums[below + 1] - sums[below]) * (place - below)
    while k < count:
        place += step
        step += bend
        if place > last:
            break
        below = int(place)
        now = sums[below] + (sums[below + 1] - sums[below]) * (place - below)
        total += (now - value) * (now - value)
        value = now
        k += 1
    return total


@_jit
def grid_energy(sums: Array, middle: float, cell: float, bend: float, first: float, count: int) -> float:
    """Mean square of `half_levels`."""
    start = middle + cell * (first + bend * first * first)
    half = cell * (0.5 + bend * (first + 0.25))  # the first one; second differences are constant
    total = energy(sums, start, half, 0.5 * bend * cell, 2 * count)
    return total * 4.0 / (cell * cell * 2.0 * count)


@_jit
def best_grid(
    sums: Array, grid: Array, first: float, count: int, shifts: Array, stretches: Array, bends: Array
) -> Array:
    """The grid near another, its middle moved in cells and its length stretched, of most energy."""
    best, found = -1.0, grid.copy()
    for bend in bends:
        for stretch in stretches:
            cell = grid[1] * (1.0 + stretch)
            for shift in shifts:
                middle = grid[0] + shift * grid[1]
                energy = grid_energy(sums, middle, cell, grid[2] + bend, first, count)
                if energy > best:
                    best = energy
                    found[0], found[1], found[2] = middle, cell, grid[2] + bend
    return found


@_jit
def scan_lengths(sums: Array, begin: float, span: float, halves: Array, phases: int) -> Array:
    """For each length of a half cell the largest mean square level over the phases, and that edge, (H, 2)."""
    rows = np.empty((len(halves), 2))
    for i, half in enumerate(halves):
        count = int(span / half) - 1
        rows[i, 0] = -1.0
        for phase in range(phases):
            start = begin + half * phase / phases
            total = energy(sums, start, half, 0.0, count) / (half * half * count)
            if total > rows[i, 0]:
                rows[i, 0], rows[i, 1] = total, start
    return rows


@_jit
def sync_means(bits: Array, pattern: Array, word: int) -> Array:
    """Mean number of bits (word,) that agree with a pattern (M,) from each place of the words on."""
    totals, words = np.zeros(word), np.zeros(word)
    for i in range(len(bits) - len(pattern) + 1):
        agreeing = 0
        for j in range(len(pattern)):
            agreeing += bits[i + j] == pattern[j]
        totals[i % word] += agreeing
        words[i % word] += 1.0
    return totals / np.maximum(words, 1.0)


@_jit
def best_path(halves: Array, wanted: Array, before: float) -> tuple[float, Array, Array]:
    """The bits that explain half-cell levels best (Viterbi), some of which may be given.

    At every cell's start the level changes sign, in the middle of a one it does so again: the state
    is the sign of a cell's first half.

    Args:
        halves: (2 N,).
        wanted: (N,) 0, 1 or `FREE`.
        before: sum of levels that speaks for a positive first half.

    Returns: the sum of levels times signs and of what is before, the bits (N,), the signs (2 N,).
    """
    count = len(wanted)
    one_into = np.empty((count, 2), np.bool_)
    plus, minus = before, -before
    for k in range(count):
        zero, one = halves[2 * k] + halves[2 * k + 1], halves[2 * k] - halves[2 * k + 1]
        plus_one, minus_one, plus_zero, minus_zero = plus + one, minus - one, minus - zero, plus + zero
        if wanted[k] == 0:
            plus_one = minus_one = -np.inf
        elif wanted[k] == 1:
            plus_zero = minus_zero = -np.inf
        one_into[k, 0], one_into[k, 1] = plus_one >= plus_zero, minus_one >= minus_zero
        plus, minus = max(plus_one, plus_zero), max(minus_one, minus_zero)
    bits, signs = np.empty(count, np.int8), np.empty(2 * count, np.int8)
    state = 0 if plus >= minus else 1
    for k in range(count - 1, -1, -1):
        one = one_into[k, state]
        bits[k] = one
        if not one:
            state = 1 - state
        sign = 1 - 2 * state
        signs[2 * k], signs[2 * k + 1] = sign, -sign if one else sign
    return max(plus, minus), bits, signs


@_jit
def soft_bits(halves: Array, wanted: Array, before: float) -> Array:
    """How much better (N,) the best path through a one is than that through a zero, see `best_path`."""
    count = len(wanted)
    after = np.zeros((count + 1, 2))
    for k in range(count - 1, -1, -1):
        zero, one = halves[2 * k] + halves[2 * k + 1], halves[2 * k] - halves[2 * k + 1]
        for state in range(2):
            sign = 1.0 - 2.0 * state
            of_one, of_zero = after[k + 1, state] + sign * one, after[k + 1, 1 - state] + sign * zero
            if wanted[k] == 0:
                of_one = -np.inf
            elif wanted[k] == 1:
                of_zero = -np.inf
            after[k, state] = max(of_one, of_zero)
    soft = np.zeros(count)
    until = np.array([before, -before])
    for k in range(count):
        zero, one = halves[2 * k] + halves[2 * k + 1], halves[2 * k] - halves[2 * k + 1]
        ones = np.array([until[0] + one, until[1] - one])  # by the next state
        zeros = np.array([until[1] - zero, until[0] + zero])
        if wanted[k] == FREE:
            of_one = max(ones[0] + after[k + 1, 0], ones[1] + after[k + 1, 1])
            soft[k] = of_one - max(zeros[0] + after[k + 1, 0], zeros[1] + after[k + 1, 1])
            until[0], until[1] = max(ones[0], zeros[0]), max(ones[1], zeros[1])
        elif wanted[k] == 1:
            until = ones
        else:
            until = zeros
    return soft


@_jit
def moved_grid(grid: Array, cells: float) -> Array:
    """The same grid about another middle."""
    middle, cell, bend = grid
    turn = 1.0 + 2.0 * bend * cells
    return np.array([middle + cell * (cells + bend * cells * cells), cell * turn, bend / turn])


@_jit
def drawn_grid(sums: Array, grid: Array, signs: Array, level: float, terms: int) -> Array:
    """The grid moved to the edges of a word whose signs (2 N,) are known.

    The integral over a quarter of a cell to both sides of an edge is zero if the edge is in the middle.

    Args:
        level: of the signal.
        terms: 2 for middle and cell, 3 for the bend as well.
    """
    middle, cell, bend = grid
    first = -0.25 * len(signs)
    reach = 0.25 * cell
    normal, right = 1e-9 * np.eye(terms), np.zeros(terms)
    for k in range(1, len(signs)):
        if signs[k] == signs[k - 1]:
            continue
        u = first + 0.5 * k
        place = middle + cell * (u + bend * u * u)
        sum_here = integral(sums, place + reach) - integral(sums, place - reach)
        error = min(max(-signs[k] * sum_here / (2.0 * level), -reach), reach) / cell
        powers = np.array([1.0, u, u * u])
        for i in range(terms):
            right[i] += powers[i] * error
            for j in range(terms):
                normal[i, j] += powers[i] * powers[j]
    change = np.linalg.solve(normal, right)
    moved = grid.copy()
    moved[0] += change[0] * cell
    moved[1] *= 1.0 + change[1]
    if terms == 3:
        moved[2] += change[2]
    return moved


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
def verdict(
    halves: Array, wanted: Array, before: float, free: float
) -> tuple[float, float, float, float, float, Array, Array]:
    """How given bits fit levels, see `best_path`.

    Returns: nats by which they are worse than the best bits, which score `free`; the level; the share of the
    magnitude that is explained; the least level of the ten tenths, and of a tenth anywhere; bits and signs.
    """
    score, bits, signs = best_path(halves, wanted, before)
    count = len(halves)
    told = score - before * signs[0]
    level = told / count
    square, total = 0.0, 0.0
    tenths = np.zeros(10)
    explained = np.zeros(count + 1)
    for k in range(count):
        square += halves[k] * halves[k]
        total += abs(halves[k])
        tenths[10 * k // count] += halves[k] * signs[k]
        explained[k + 1] = explained[k] + halves[k] * signs[k]
    tenth, least = max(count // 10, 1), np.inf
    for k in range(0, count - tenth + 1, max(tenth // 4, 1)):
        least = min(least, (explained[k + tenth] - explained[k]) / tenth)
    noise = max(square / count - level * level, (LEAST_NOISE * level) ** 2)
    nats = level * (free - score) / noise if noise > 0.0 else np.inf
    share = told / total if total > 0.0 else 0.0
    return nats, level, share, tenths.min() * 10.0 / count, least, bits, signs


@lru_cache(maxsize=1)
def compile_kernels() -> None:
    """Compile all kernels for the types that they are called with, or take them from numba's cache."""
    sums, grid, few = np.cumsum(np.ones(400)), np.array([200.0, 20.0, 0.0]), np.zeros(1)
    halves, wanted = np.ones(16), np.full(8, FREE, np.int8)
    half_levels(sums, 200.0, 20.0, 0.0, -4.0, 8)
    best_grid(sums, grid, -4.0, 8, few, few, few)
    scan_lengths(sums, 0.0, 200.0, np.array([10.0]), 2)
    _, _, signs = best_path(halves, wanted, 0.0)
    soft_bits(halves, wanted, 0.0)
    sync_means(wanted, wanted[:4], 4)
    moved_grid(grid, 1.0)
    edge_places(wanted)
    edge_places(wanted[::-1])
    drawn_grid(sums, grid, signs, 1.0, 2)
    verdict(halves, wanted, 0.0, 0.0)
