"""The levels of the half cells of a word, and their polarity by the sync word before it.

A word alone has two polarities. A change of its bit 0 then only turns the sign of its first half cell,
which noise does as easily. So words that stand still could be read as if they counted on. The sync word
that was sent just before has one polarity only, and a cell always begins with a transition.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.timecode.signal.grid import Grid
from panoptic_ros.timecode.signal.half_cells import half_levels, tick_levels
from panoptic_ros.timecode.word.layout import SYNC, WORD_CELLS

Array = np.ndarray
LEAST_SYNC = 0.8  # share of the levels' magnitude before a word that a sync word must explain


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
