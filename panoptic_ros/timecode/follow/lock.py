"""Lock to a signal that was found, if its words are readable and have consecutive labels."""

from __future__ import annotations

import math
from copy import copy
from dataclasses import replace

import numpy as np

from panoptic_ros.timecode.config import TimecodeConfig
from panoptic_ros.timecode.follow.following import SignalTracker
from panoptic_ros.timecode.follow.reading import read_word, word_complete
from panoptic_ros.timecode.follow.wander import Wander
from panoptic_ros.timecode.label.evidence import judge
from panoptic_ros.timecode.label.expected import ExpectedLabels
from panoptic_ros.timecode.label.stretch import solve_labels
from panoptic_ros.timecode.signal.half_cells import CellGrid, moved_grid
from panoptic_ros.timecode.signal.stream import Stream
from panoptic_ros.timecode.word.acquisition import EARLY, AcquiredSignal, SearchParameters, steady, tracked
from panoptic_ros.timecode.word.layout import SYNC_ONLY, WORD_CELLS
from panoptic_ros.timecode.word.tracking import BEFORE, TICKS, word_ticks
from panoptic_ros.timecode.word.viterbi import ticks_levels, word_levels

Array = np.ndarray
FARTHEST = 3  # consecutive unreadable words allowed between readable ones at changing speed
# maximum ratio of the edge scatter at changing speed to that at constant speed, to prefer the former
CLEARLY = 0.8
ABOUT = 8  # number of cells over which the cell length is measured


def lock(
    stream: Stream, found: AcquiredSignal, search: SearchParameters, config: TimecodeConfig, read_until: float
) -> SignalTracker | None:
    """Return the signal to follow from its first word; None if its words have no consecutive labels.

    Args:
        search: search by which the signal was found.
        read_until: sample up to which words have already been read.
    """
    signals, stretch = _even(stream, found, search)
    tried = [_follow(stream, signal, stretch, config, read_until) for signal in signals]
    read = [each for each in tried if each is not None]
    on_line = [(trial.scatter, follow) for trial, follow in read if trial.wander is None]
    even = min(on_line, key=lambda item: item[0], default=(math.inf, None))
    if found.ticks is None:
        if even[1] is not None or not read:
            return even[1]
        begin = len(stream.sums) - 1 - search.seconds * stream.sums_rate
        found = tracked(stream.sums, begin, found) or found
    if found.ticks is None:
        return read[0][1]
    swinging = _follow(stream, found, search, config, read_until)
    if swinging is None or swinging[0].scatter > CLEARLY * even[0]:
        return even[1] or (read[0][1] if read else None)
    return swinging[1]


def _even(
    stream: Stream, found: AcquiredSignal, search: SearchParameters
) -> tuple[list[AcquiredSignal], SearchParameters]:
    """Return candidates of the same signal at constant speed, and the search stretch for them."""
    if found.ticks is None:
        return [found], search
    sums, chain = stream.sums, _chain(stream.sums, found.ticks, found)
    if len(chain) < 2:
        return [], search
    begin = chain[0][0 if found.reverse else BEFORE]
    cell = (chain[-1][0] - chain[0][0]) / (WORD_CELLS * (len(chain) - 1))
    seconds = (len(sums) - begin + cell) / stream.sums_rate
    return list(steady(sums, begin, cell, found)), replace(search, seconds=seconds)


def _follow(
    stream: Stream, found: AcquiredSignal, search: SearchParameters, config: TimecodeConfig, read_until: float
) -> tuple[SignalTracker, SignalTracker] | None:
    """Follow a signal up to its newest word as a trial; see `lock`.

    Returns: the state after the trial, and a fresh state at the first word; None if there are no consecutive
    labels.
    """
    wander, number = None, 0
    if found.ticks is not None:
        chain = _chain(stream.sums, found.ticks, found)
        words = [ticks_levels(stream.sums, ticks, found.reverse) for ticks in chain]
    else:
        grids = _row(stream, found, search)
        words = [word_levels(stream.sums, grid, found.reverse) for grid in grids]
    solution = solve_labels(words, found.reverse, config.agreeing_words)
    if solution is None:
        return None
    if found.ticks is not None:
        wander, number = _first_tracked(stream, chain, found.reverse, read_until)
        grid = wander.grid
    else:
        grid, number = _first_word(stream, stream.in_recorded(grids[0]), read_until)
    trial = SignalTracker(grid, number, ExpectedLabels(solution), found.reverse, copy(wander))
    while trial.misses < config.lost_words and word_complete(trial, stream):
        read_word(trial, stream)
    if trial.read < config.agreeing_words:
        return None
    if trial.wander is None and trial.cell and trial.first is not None:  # the speed is constant after all
        first, middle = trial.first
        grid = moved_grid(CellGrid(middle, trial.cell), float(WORD_CELLS * (number - first)))
        if wander is not None:
            wander, (grid, before) = None, _first_word(stream, grid, read_until)
            number += before
    return trial, SignalTracker(
        grid, number, ExpectedLabels(solution, trial.labels.user), found.reverse, wander
    )


def _first_tracked(
    stream: Stream, chain: list[Array], reverse: bool, read_until: float
) -> tuple[Wander, int]:
    """Return the motion and number of the first unread word, from the ticks of words on the running sum."""
    number = 0
    wander = _from_ticks(stream, chain[0], reverse)
    while number + 1 < len(chain) and _begin_of(wander.grid) < read_until - 0.5 * wander.grid.cell:
        number += 1
        wander = _from_ticks(stream, chain[number], reverse)
    wander.level = judge(ticks_levels(stream.sums, chain[number], reverse), SYNC_ONLY).level
    return wander, number


def _from_ticks(stream: Stream, ticks: Array, reverse: bool) -> Wander:
    """Return the motion at a word whose ticks on the running sum are given."""
    ticks = stream.ticks_in_recorded(ticks)
    cell = float(ticks[2 * ABOUT] - ticks[0]) / ABOUT
    return Wander(reverse, float(ticks[0]), cell, ticks)


def _first_word(stream: Stream, grid: CellGrid, read_until: float) -> tuple[CellGrid, int]:
    """Return the grid and number of the first unread word in the kept samples, from the grid of word 0."""
    number = 0
    earliest = max(stream.first - EARLY * grid.cell, read_until - 0.5 * grid.cell)
    while _begin_of(before := moved_grid(grid, -float(WORD_CELLS))) >= earliest:
        grid, number = before, number - 1
    while _begin_of(grid) < earliest:
        grid, number = moved_grid(grid, float(WORD_CELLS)), number + 1
    return grid, number


def _begin_of(grid: CellGrid) -> float:
    """Return the sample at which a word begins."""
    return grid.middle - 0.5 * WORD_CELLS * grid.cell


def _row(stream: Stream, found: AcquiredSignal, search: SearchParameters) -> list[CellGrid]:
    """Return the grids of all words in the newest part of the signal, at constant word length."""
    length = WORD_CELLS * found.grid.cell
    end = len(stream.sums) - 1
    begin = end - search.seconds * stream.sums_rate
    first = -int((found.grid.middle - 0.5 * length - begin) / length)
    last = int((end - found.grid.middle - 0.5 * length) / length)
    return [moved_grid(found.grid, float(WORD_CELLS * k)) for k in range(first, last + 1)]


def _chain(sums: Array, ticks: Array, found: AcquiredSignal) -> list[Array]:
    """Return the ticks of all tracked words, in both directions from the word that was found."""
    before = _one_side(sums, ticks, found.begin - TICKS, -TICKS, found.reverse)
    return [*before[::-1], *_one_side(sums, ticks, found.begin, TICKS, found.reverse)]


def _one_side(sums: Array, ticks: Array, begin: int, step: int, reverse: bool) -> list[Array]:
    """Return the ticks of consecutive words in one direction, up to the last readable one."""
    words: list[Array] = []
    good = 0
    while len(words) - good < FARTHEST and (word := word_ticks(ticks, begin, reverse)) is not None:
        words.append(word)
        if judge(ticks_levels(sums, word, reverse), SYNC_ONLY).good:
            good = len(words)
        begin += step
    return words[:good]
