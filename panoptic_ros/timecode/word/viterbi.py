"""Bits from the levels of half cells: a two-state Viterbi search, soft and free of polarity.

A word alone has two polarities. A change of its bit 0 then only turns the sign of its first half cell,
which noise does as easily. So words that stand still could be read as if they counted on. The sync word
that was sent just before has one polarity only, and a cell always begins with a transition.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.timecode.signal.half_cells import Grid, half_levels, tick_levels
from panoptic_ros.timecode.word.layout import FREE, SYNC, WORD_CELLS

Array = np.ndarray
_jit = njit(cache=True, error_model="numpy", nogil=True)
LEAST_NOISE = 0.35  # of the level: what noise-free recordings have from echoes and filters
LEAST_SYNC = 0.8  # share of the levels' magnitude before a word that a sync word must explain


class Path(NamedTuple):
    """Bits (N,) and signs (2 N,) of half cells, and the sum of levels times signs and of what is before."""

    score: float
    bits: Array
    signs: Array


class Match(NamedTuple):
    """How given bits fit levels.

    Args:
        nats: by which they are worse than the best bits.
        level: of the signal.
        share: of the magnitude that is explained.
        tenth: the least level of the ten tenths.
        anywhere: the least level of a tenth that begins anywhere.
        bits, signs: see `Path`.
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
    """The bits that explain half-cell levels best (Viterbi), some of which may be given.

    At every cell's start the level changes sign, in the middle of a one it does so again: the state
    is the sign of a cell's first half.

    Args:
        halves: (2 N,).
        wanted: (N,) 0, 1 or `FREE`.
        before: sum of levels that speaks for a positive first half.
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
def match(halves: Array, wanted: Array, before: float, free: float) -> Match:
    """How given bits fit levels, see `best_path`; the best bits score `free`."""
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
    return Match(nats, level, share, tenths.min() * 10.0 / count, least, bits, signs)


def _signs_before() -> Array:
    """Signs of the half cells of a sync word that a positive half cell follows."""
    signs, first = [], 1.0
    for bit in SYNC:
        signs += [first, -first] if bit else [first, first]
        first = first if bit else -first
    return first * np.array(signs)


SIGNS_BEFORE = _signs_before()


@dataclass(frozen=True, slots=True)
class WordLevels:
    """Levels of a word, in the order of sending.

    Args:
        halves: (160,) of its half cells.
        before: correlation with the sync word before it; positive if the first half cell is.
    """

    halves: Array
    before: float = 0.0


def word_levels(sums: Array, grid: Grid, reverse: bool) -> WordLevels:
    """The levels of the word on a grid; what lies outside of the sums counts as 0."""
    first = -0.5 * WORD_CELLS - (0 if reverse else len(SYNC))
    return _in_order(half_levels(sums, grid, first, WORD_CELLS + len(SYNC)), reverse)


def ticks_levels(sums: Array, ticks: Array, reverse: bool) -> WordLevels:
    """The levels of the word between ticks, see `word_ticks`."""
    return _in_order(tick_levels(sums, ticks), reverse)


def _in_order(levels: Array, reverse: bool) -> WordLevels:
    """Levels of a word and of the sync word before it as in the stream, in the order of sending."""
    if reverse:
        levels = np.ascontiguousarray(levels[::-1])
    sync, halves = levels[: 2 * len(SYNC)], levels[2 * len(SYNC) :]
    before = float(sync @ SIGNS_BEFORE)
    return WordLevels(halves, before if abs(before) > LEAST_SYNC * float(np.abs(sync).sum()) else 0.0)
