"""Decode bits from half-cell levels with a two-state Viterbi search: soft bits, independent of polarity.

A single word has two possible polarities. A change of its bit 0 then only flips the sign of its first half
cell, as noise can do too. Stopped timecode could therefore be read as consecutive labels. The sync word sent
just before has one polarity only, and a cell always begins with a transition. It therefore resolves the
ambiguity.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.timecode.signal.half_cells import CellGrid, half_levels, tick_levels
from panoptic_ros.timecode.word.layout import FREE, SYNC, WORD_CELLS

Array = np.ndarray
_jit = njit(cache=True, error_model="numpy", nogil=True)
LEAST_NOISE = 0.35  # minimum noise over level: echoes and filters cause this much even without noise
LEAST_SYNC = 0.8  # minimum share of the level magnitude that the sync word before a word must explain


class Path(NamedTuple):
    """Best path of the Viterbi search.

    Args:
        score: sum of levels times signs, plus the term for the sync word before the word.
        bits: (N,) decoded bits.
        signs: (2 N,) signs of the half cells.
    """

    score: float
    bits: Array
    signs: Array


class BitFit(NamedTuple):
    """Fit of given bits to half-cell levels.

    Args:
        nats: (nats) log-likelihood by which the given bits fit worse than the best bits.
        level: Mean level of the signal.
        share: (0..1) share of the level magnitude that the bits explain.
        tenth: Smallest mean level among ten fixed, adjacent tenths of the word.
        anywhere: Smallest mean level in a sliding window of a tenth of the word, moved by a quarter of the
            window.
        bits, signs: See `Path`.
    """

    nats: float
    level: float
    share: float
    tenth: float
    anywhere: float
    bits: Array
    signs: Array


@_jit
def best_path(halves: Array, wanted: Array, before: float) -> Path:
    """Return the bits that best explain the half-cell levels (Viterbi); some bits may be given.

    The level changes sign at the start of every cell, and also in the middle of a one. The state is the sign
    of the first half of a cell.

    Args:
        halves: (2 N,) half-cell levels.
        wanted: (N,) given bits: 0, 1 or `FREE`.
        before: sum of levels in favour of a positive first half cell.
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
    return Path(max(plus, minus), bits, signs)


@_jit
def soft_bits(halves: Array, wanted: Array, before: float) -> Array:
    """Return the score (N,) of the best path with a one minus that with a zero, per bit; see `best_path`.

    The result is 0 for given bits.
    """
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
        ones = np.array([until[0] + one, until[1] - one])  # indexed by the next state
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
def match(halves: Array, wanted: Array, before: float, free: float) -> BitFit:
    """Return how well given bits fit the levels, see `best_path`; `free` is the score of the best bits."""
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
    return BitFit(nats, level, share, tenths.min() * 10.0 / count, least, bits, signs)


def _signs_before() -> Array:
    """Return the half-cell signs of a sync word that is followed by a positive half cell."""
    signs, first = [], 1.0
    for bit in SYNC:
        signs += [first, -first] if bit else [first, first]
        first = first if bit else -first
    return first * np.array(signs)


SIGNS_BEFORE = _signs_before()


@dataclass(frozen=True, slots=True)
class WordLevels:
    """Half-cell levels of a word, in the order of sending.

    Args:
        halves: (160,) levels of its half cells.
        before: correlation with the sync word before the word; positive if its first half cell is positive.
    """

    halves: Array
    before: float = 0.0


def word_levels(sums: Array, grid: CellGrid, reverse: bool) -> WordLevels:
    """Return the levels of the word on a grid; positions outside the running sum are treated as 0."""
    first = -0.5 * WORD_CELLS - (0 if reverse else len(SYNC))
    return _in_order(half_levels(sums, grid, first, WORD_CELLS + len(SYNC)), reverse)


def ticks_levels(sums: Array, ticks: Array, reverse: bool) -> WordLevels:
    """Return the levels of the word between ticks, see `word_ticks`."""
    return _in_order(tick_levels(sums, ticks), reverse)


def _in_order(levels: Array, reverse: bool) -> WordLevels:
    """Reorder the levels of a word and of the sync word before it, from stream order to sending order."""
    if reverse:
        levels = np.ascontiguousarray(levels[::-1])
    sync, halves = levels[: 2 * len(SYNC)], levels[2 * len(SYNC) :]
    before = float(sync @ SIGNS_BEFORE)
    return WordLevels(halves, before if abs(before) > LEAST_SYNC * float(np.abs(sync).sum()) else 0.0)
