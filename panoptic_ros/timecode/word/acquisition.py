"""Acquire a timecode signal without prior information: cell grid, direction and word positions.

The energy of half-cell integrals is maximal if every edge lies between two half cells. It is computed for all
cell lengths and phases over a short stretch, then refined over longer stretches. Bit patterns can favour a
multiple of the true cell length. Therefore the best few lengths are tried in full.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from panoptic_ros.timecode.signal.half_cells import CellGrid, half_levels, moved_grid, tick_levels
from panoptic_ros.timecode.word.layout import FREE, SYNC, SYNC_BACK, WORD_CELLS
from panoptic_ros.timecode.word.search import best_grid, scan_lengths, sync_means
from panoptic_ros.timecode.word.tracking import TICKS, track
from panoptic_ros.timecode.word.viterbi import best_path

Array = np.ndarray
PHASES = 8
CANDIDATES = 3  # number of cell lengths tried for each of the two measures
APART = 0.03  # minimum relative difference between the cell lengths of two candidates
FASTEST, SLOWEST = 30.0, 24000.0 / 1001.0  # frames/s
EARLY = 0.3  # cells that may be missing at the start of the first word of a stream
FASTER = 1.2  # maximum ratio of the tape speed before the tracked stretch to the mean speed in it
SHIFTS, STRETCHES = np.linspace(-0.25, 0.25, 5), np.linspace(-1.0, 1.0, 5)


@dataclass(frozen=True, slots=True)
class SearchParameters:
    """Parameters of a search for a signal.

    Args:
        seconds: (s) length of the newest part of the signal that is searched.
        coarse: (s) length of the first step; the speed must be nearly constant over it.
        longer: (s) lengths of the refinement steps.
        tracked: True if the speed may change; half cells are then tracked edge by edge.
        least_sync: (bits, of 16) minimum mean number of matching sync bits per word.
        least_share: (0..1) minimum share of the signal power in the half cells of the best length.
    """

    seconds: float
    coarse: float
    longer: tuple[float, ...]
    tracked: bool
    least_sync: float
    least_share: float = 0.0


SHORT = SearchParameters(0.22, 0.06, (0.12, 0.22), False, 14.5)  # for a signal that has just begun
LONG = SearchParameters(0.6, 0.1, (0.15, 0.3, 0.6), False, 12.0)  # for noisy signals
CHANGING = SearchParameters(0.12, 0.03, (), True, 15.0, 0.4)  # for wow and flutter


@dataclass(frozen=True, slots=True)
class AcquiredSignal:
    """Signal found by a search.

    Args:
        grid: cell grid about the middle of a word, samples.
        reverse: True if the tape runs backwards.
        sync: (bits, of 16) mean number of matching sync bits.
        ticks: (N,) boundaries of the half cells over all kept samples; None if the signal was not tracked.
        begin: index of the tick at which a word begins in the stream.
    """

    grid: CellGrid
    reverse: bool
    sync: float
    ticks: Array | None = None
    begin: int = 0


def acquire(
    sums: Array, sample_rate: int, speed_range: float, search: SearchParameters
) -> list[AcquiredSignal]:
    """Return up to two candidate signals in the newest part of the samples, best first.

    Args:
        sums: (N + 1,) running sum of the conditioned samples, see `integral`.
        sample_rate: Hz, rate of the conditioned samples.
        speed_range: largest factor by which the tape may run too fast or too slow.
    """
    shortest = sample_rate / (FASTEST * speed_range * WORD_CELLS)
    longest = sample_rate * speed_range / (SLOWEST * WORD_CELLS)
    length = len(sums) - 1
    if length < search.seconds * sample_rate:
        return []
    begin = length - search.seconds * sample_rate
    found: list[AcquiredSignal] = []
    for half, edge in _coarse(sums, begin, 0.5 * shortest, 0.5 * longest, sample_rate, search):
        if search.tracked:
            found += _tracked(sums, begin, half, edge)
            continue
        grid = _refine(sums, begin, half, edge, sample_rate, search)
        if shortest < grid.cell < longest:
            found += _words(sums, begin, grid)
    good = [item for item in found if item.sync >= search.least_sync]
    return sorted(good, key=lambda item: -item.sync)[:2]


def _coarse(
    sums: Array, begin: float, shortest: float, longest: float, sample_rate: int, search: SearchParameters
) -> Iterator[tuple[float, float]]:
    """Yield pairs (half-cell length, edge) in samples that best explain the middle of the stretch."""
    span = search.coarse * sample_rate
    begin = begin + 0.5 * (search.seconds - search.coarse) * sample_rate
    steps = int(2.0 * span / shortest * np.log(longest / shortest)) + 2
    lengths = shortest * (longest / shortest) ** np.linspace(0.0, 1.0, steps)
    rows = scan_lengths(sums, begin, span, lengths, PHASES)
    first, last = int(begin), int(begin + span)
    power = float(np.mean(np.diff(sums[first : last + 1]) ** 2))
    if rows[:, 0].max() <= search.least_share * power:
        return
    chosen: list[float] = []
    # The first measure favours short cells in noise; the second favours long cells for words of zeros.
    for measure in (rows[:, 0], rows[:, 0] * lengths):
        number = 0
        for k in np.argsort(-measure):
            if all(abs(lengths[k] / other - 1.0) > APART for other in chosen):
                chosen.append(lengths[k])
                yield float(lengths[k]), float(rows[k, 1])
                number += 1
            if number == CANDIDATES:
                break


def _refine(
    sums: Array, begin: float, half: float, edge: float, sample_rate: int, search: SearchParameters
) -> CellGrid:
    """Return the grid about the middle of the stretch, refined over growing parts around it."""
    middle = begin + 0.5 * search.seconds * sample_rate
    grid = CellGrid(edge + half * round((middle - edge) / half), 2.0 * half)
    for seconds in search.longer:
        each_side = int(0.49 * seconds * sample_rate / grid.cell)
        grid = refined(sums, grid, -each_side, 2 * each_side)
    return grid


def refined(sums: Array, grid: CellGrid, first: int, count: int) -> CellGrid:
    """Return the grid of maximum energy near a given one, over `count` cells from cell `first`."""
    stretch = 1.0 / count
    for scale in (1.0, 0.5, 0.25, 0.125):
        steps = 0.5 * scale * SHIFTS, scale * stretch * STRETCHES
        grid = best_grid(sums, grid, float(first), count, *steps)
    return grid


def _words(sums: Array, begin: float, grid: CellGrid) -> Iterator[AcquiredSignal]:
    """Yield the word positions on a grid, one per direction."""
    before = int((grid.middle - begin) / grid.cell) - 1
    halves = half_levels(sums, grid, -float(before), 2 * before)
    for half, reverse, mean in _sync_places(halves, _even_parity(halves)):
        u = 0.5 * half - before + 0.5 * WORD_CELLS
        yield AcquiredSignal(moved_grid(grid, u), reverse, mean)


def _tracked(sums: Array, begin: float, half: float, edge: float) -> Iterator[AcquiredSignal]:
    """Yield the word positions on half cells tracked from an edge, one per direction."""
    ticks = _all_ticks(sums, begin, edge, half)
    first = int(np.searchsorted(ticks, begin))
    levels = tick_levels(sums, ticks[first:])
    for found, reverse, mean in _sync_places(levels, _louder_after(levels)):
        at = first + found
        if at < 0 or at + TICKS >= len(ticks):
            continue
        word = ticks[at : at + TICKS + 1]
        grid = CellGrid(word[WORD_CELLS], (word[-1] - word[0]) / WORD_CELLS)
        yield AcquiredSignal(grid, reverse, mean, ticks, at)


def steady(sums: Array, begin: float, cell: float, found: AcquiredSignal) -> Iterator[AcquiredSignal]:
    """Yield a tracked signal on the constant-speed grid of maximum energy.

    If plateaus droop to zero, it is ambiguous which half cell begins a cell. Both alternatives are then
    yielded.

    Args:
        begin: start of the tracked words, samples.
        cell: mean cell length of the tracked words, samples.
    """
    before = int((found.grid.middle - begin) / cell)
    after = int((len(sums) - 1 - found.grid.middle) / cell)
    grid = refined(sums, CellGrid(found.grid.middle, cell), -before, before + after)
    own = moved_grid(grid, 0.5 * round(2.0 * (found.grid.middle - grid.middle) / grid.cell))
    yield replace(found, grid=own, ticks=None)
    for word in _words(sums, begin, moved_grid(grid, 0.5 * (after - before))):
        if word.reverse == found.reverse and word.sync >= SHORT.least_sync:
            cells = (word.grid.middle - own.middle) / grid.cell
            if abs(cells - round(cells)) > 0.25:
                yield word


def tracked(sums: Array, begin: float, found: AcquiredSignal) -> AcquiredSignal | None:
    """Track a signal that was found at constant speed, from the middle of its word.

    Args:
        begin: start of the newest part of the signal, from which the level is computed.

    Returns: the signal with its ticks; None if its word begins before the first tick.
    """
    ticks = _all_ticks(sums, begin, found.grid.middle, 0.5 * found.grid.cell)
    at = int(np.argmin(np.abs(ticks - found.grid.middle))) - WORD_CELLS
    return None if at < 0 else AcquiredSignal(found.grid, found.reverse, found.sync, ticks, at)


def _all_ticks(sums: Array, begin: float, edge: float, half: float) -> Array:
    """Track the half cells from an edge to the end, and then back through all kept samples.

    A stream often begins with the first edge of a word. Tracking may place the tick of that edge slightly
    before the stream. Therefore ticks up to `EARLY` cells before the stream are kept as well.

    Returns: (N,) ticks, positions on the running sum.
    """
    end = len(sums) - 1.0
    level = float(np.sqrt(np.mean(np.diff(sums[int(begin) :]) ** 2)))
    there = track(sums, edge, 2.0 * half, max(2, int((end - edge) / half) - 2), level)
    inside = there[there < end]
    half = (inside[-1] - inside[0]) / (len(inside) - 1)
    count = int(FASTER * inside[-1] / half) + 1
    back = track(sums, inside[-1], 2.0 * (inside[-2] - inside[-1]), count, level)
    return np.ascontiguousarray(back[(back >= -2.0 * EARLY * half) & (back <= end)][::-1])


def _sync_places(halves: Array, even: bool) -> Iterator[tuple[int, bool, float]]:
    """Yield the half cell where a word begins, the direction and the mean sync bits, for both directions.

    Args:
        halves: (N,) half-cell levels.
        even: True if cells begin at even half cells.
    """
    count, first = len(halves) // 2, 0
    if not even:
        first, count = 1, (len(halves) - 1) // 2
    if count < WORD_CELLS + len(SYNC):
        return
    bits = best_path(halves[first : first + 2 * count], np.full(count, FREE, np.int8), 0.0).bits
    for reverse in (False, True):
        means = sync_means(bits, SYNC_BACK if reverse else SYNC, WORD_CELLS)
        best = int(np.argmax(means))
        word = best if reverse else best + len(SYNC)  # a sync word is the end of a word
        number = round((0.5 * count - word) / WORD_CELLS - 0.5)
        yield first + 2 * (word + WORD_CELLS * number), reverse, float(means[best])


def _even_parity(halves: Array) -> bool:
    """Return whether cells begin at even half cells: the level always changes sign between two cells."""
    product = halves[:-1] * halves[1:]
    return float(product[1::2].sum()) <= float(product[0::2].sum())


def _louder_after(halves: Array) -> bool:
    """Return whether cells begin at even half cells, for signals whose plateaus may droop to zero.

    In these signals the level is louder after an edge than before the edge.
    """
    before, after = halves[:-1], halves[1:]
    edges = 0.5 * (after**2 - before**2) - before * after
    return float(edges[1::2].sum()) >= float(edges[0::2].sum())
