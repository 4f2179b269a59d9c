"""Locking to a signal that was found: the labels of its words must count on, and words must be readable."""
from __future__ import annotations

import numpy as np

from panoptic_ros.timecode.config import TimecodeConfig
from panoptic_ros.timecode.follow.following import Follow
from panoptic_ros.timecode.follow.pace import Pace
from panoptic_ros.timecode.follow.reading import read_word, word_complete
from panoptic_ros.timecode.label.evidence import judge
from panoptic_ros.timecode.label.expected import ExpectedLabels
from panoptic_ros.timecode.label.stretch import solve_labels
from panoptic_ros.timecode.signal.edge_shape import EdgeShape
from panoptic_ros.timecode.signal.grid import Grid, moved_grid
from panoptic_ros.timecode.signal.stream import Stream
from panoptic_ros.timecode.word.acquisition import Found, Search
from panoptic_ros.timecode.word.bit_clock import drawn_grid, nearby_grid
from panoptic_ros.timecode.word.layout import SYNC_ONLY, WORD_CELLS
from panoptic_ros.timecode.word.levels import word_levels

Array = np.ndarray
EARLY = 0.3  # cells that may be missing of the first word of a stream
FARTHEST = 3  # words before the first that was found, where a changing speed may still be known
PASSES = 2  # over the words heard so far: the first teaches the shape of edges, the other by it the speed


def lock(
    stream: Stream, found: Found, search: Search, config: TimecodeConfig, read_until: float
) -> Follow | None:
    """The signal that was found, to be followed from its first word on; None if it has no labels.

    Args:
        search: that it was found by.
        read_until: sample up to which words were read already.
    """
    bending = bool(search.most_bend)
    grids = _chain(stream.sums, found) if bending else _row(stream, found, search)
    words = [word_levels(stream.sums, grid, found.reverse) for grid in grids]
    solution = solve_labels(words, found.reverse, config.agreeing_words)
    if solution is None:
        return None
    grid, number = _first_word(stream, stream.in_recorded(grids[0]), bending, read_until)
    shape = EdgeShape(stream.sample_rate)
    for _ in range(PASSES):
        labels = ExpectedLabels(solution)
        follow = Follow(grid, number, labels, Pace(found.reverse, bending), shape)
        while follow.misses < config.lost_words and word_complete(follow, stream):
            read_word(follow, stream)
    if follow.read < config.agreeing_words:
        return None
    return follow.restarted(grid, number, ExpectedLabels(solution, labels.user))


def _first_word(stream: Stream, grid: Grid, bending: bool, read_until: float) -> tuple[Grid, int]:
    """The grid and number of the first word that is there, from those of word 0."""
    number = 0
    earliest = max(stream.first - EARLY * grid.cell, read_until - 0.5 * grid.cell)
    while not (bending and number == -FARTHEST):
        before = moved_grid(grid, -float(WORD_CELLS))
        if _begin_of(before) < earliest:
            break
        grid, number = before, number - 1
    while _begin_of(grid) < earliest:
        grid, number = moved_grid(grid, float(WORD_CELLS)), number + 1
    return grid, number


def _begin_of(grid: Grid) -> float:
    """Where a word begins, but for its bend."""
    return grid.middle - 0.5 * WORD_CELLS * grid.cell


def _row(stream: Stream, found: Found, search: Search) -> list[Grid]:
    """The grids of the words of constant length in the newest part of the signal."""
    length = WORD_CELLS * found.grid.cell
    end = len(stream.sums) - 1
    begin = end - search.seconds * stream.sums_rate
    first = -int((found.grid.middle - 0.5 * length - begin) / length)
    last = int((end - found.grid.middle - 0.5 * length) / length)
    return [moved_grid(found.grid, float(WORD_CELLS * k)) for k in range(first, last + 1)]


def _chain(sums: Array, found: Found) -> list[Grid]:
    """The grids of the words that can be followed from one to the next, backwards and forwards."""
    middle = _drawn(sums, found.grid, found.reverse)
    if middle is None:
        return []
    before, after = (_neighbours(sums, middle, found.reverse, step) for step in (-1, 1))
    return [*before[::-1], middle, *after]


def _neighbours(sums: Array, grid: Grid, reverse: bool, step: int) -> list[Grid]:
    """The grids of the words before (-1) or after (1) another, as far as they can be followed."""
    grids: list[Grid] = []
    beside = _drawn(sums, moved_grid(grid, step * float(WORD_CELLS)), reverse)
    while beside is not None:
        grids.append(beside)
        beside = _drawn(sums, moved_grid(beside, step * float(WORD_CELLS)), reverse)
    return grids


def _drawn(sums: Array, grid: Grid, reverse: bool) -> Grid | None:
    """The grid moved to a word's edges, if there is a word."""
    ends = [moved_grid(grid, side * (0.5 * WORD_CELLS + 0.5)).middle for side in (-1.0, 1.0)]
    if ends[0] < 0.0 or ends[1] > len(sums) - 1:
        return None
    for _ in range(2):
        verdict = judge(word_levels(sums, grid, reverse), SYNC_ONLY)
        if not verdict.good:
            grid = nearby_grid(sums, grid)
            verdict = judge(word_levels(sums, grid, reverse), SYNC_ONLY)
        if not verdict.good:
            return None
        signs = np.ascontiguousarray(verdict.signs[::-1]) if reverse else verdict.signs
        grid = drawn_grid(sums, grid, signs, verdict.level, 3)
    return grid
