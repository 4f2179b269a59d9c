"""Read the next word of a followed signal: the bits given its label, and its exact start."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import Timecode
from panoptic_ros.timecode.follow.following import SignalTracker
from panoptic_ros.timecode.follow.wander import Wander
from panoptic_ros.timecode.label.counting import with_rate
from panoptic_ros.timecode.label.evidence import LabelScore
from panoptic_ros.timecode.signal.half_cells import CellGrid, moved_grid
from panoptic_ros.timecode.signal.stream import Stream
from panoptic_ros.timecode.word.edges import EVEN, SWINGING, EdgeFit, fit_edges
from panoptic_ros.timecode.word.layout import SYNC, WORD_CELLS
from panoptic_ros.timecode.word.search import nearby_grid
from panoptic_ros.timecode.word.tracking import BETWEEN
from panoptic_ros.timecode.word.viterbi import ticks_levels, word_levels

Array = np.ndarray
SLACK = 2.0  # cells by which a word may end later than predicted if the speed changes


@dataclass(frozen=True, slots=True)
class Word:
    """A word that was read.

    Args:
        timecode: label, with the most likely frame rate so far.
        start: (samples since the start of the stream) first edge of bit 0; at the word's end in reverse.
        std: (samples) standard deviation of `start`.
        cell: (samples) length of a cell.
        reverse: True if the tape runs backwards.
        user_bits: (32 bits) user bits; 0 before any were certain.
        known: True if no other label is about as likely.
        sure: True if nothing contradicts the word.
        upheld: True if the labels of this word and of those before it are confirmed. Otherwise a later word
            must confirm them.
        end: (samples) end of the word in the stream.
        signal: number of the signal in its stream.
    """

    timecode: Timecode
    start: float
    std: float
    cell: float
    reverse: bool
    user_bits: int
    known: bool
    sure: bool
    upheld: bool
    end: float
    signal: int


def word_complete(follow: SignalTracker, stream: Stream) -> bool:
    """Return whether all samples of the next word are available."""
    after = len(SYNC) if follow.reverse else 1.0  # cells needed after the word
    if follow.wander is not None:
        after += SLACK
    return stream.holds(moved_grid(follow.grid, 0.5 * WORD_CELLS + after).middle)


def read_word(follow: SignalTracker, stream: Stream) -> Word | None:
    """Read the next word and advance the signal past it; return None if the word is missed."""
    heard = _listen(follow, stream)
    word = _timed(follow, stream, heard) if heard.verdict.possible else None
    if word is None:
        follow.miss(heard.tracked)
    return word


class _WordJudgement(NamedTuple):
    """A judged word and its half-cell boundaries.

    Args:
        ticks: (161,) boundaries of its half cells on the running sum.
        tracked: (193,) recorded samples, see `Wander.listen`; None if the word was not tracked.
    """

    verdict: LabelScore
    ticks: Array
    tracked: Array | None = None


def _listen(follow: SignalTracker, stream: Stream) -> _WordJudgement:
    """Judge the word at its expected position and, if it does not fit its label there, near it."""
    if follow.wander is not None:
        return _track(follow, follow.wander, stream)
    sums, reverse = stream.sums, follow.reverse
    grid = stream.in_sums(follow.grid)
    levels = word_levels(sums, grid, reverse)
    verdict = follow.judge(levels)
    if verdict.good and not follow.misses:
        return _WordJudgement(verdict, _ticks(grid))
    # After a miss, search even for good words: a slipped grid may fit labels that were not sent.
    moved = nearby_grid(sums, grid)
    second = follow.judge(word_levels(sums, moved, reverse))
    if verdict.good and second.level < verdict.level:  # noise has moved the grid away
        return _WordJudgement(follow.judge(levels), _ticks(grid))
    return _WordJudgement(second, _ticks(moved))


def _ticks(grid: CellGrid) -> Array:
    """Return the half-cell boundaries (161,) of a word at constant speed."""
    return grid.middle + grid.cell * BETWEEN


def _track(follow: SignalTracker, wander: Wander, stream: Stream) -> _WordJudgement:
    """Judge the word on tracked half cells."""
    ticks = wander.listen(stream)
    verdict = follow.judge(ticks_levels(stream.sums, ticks, follow.reverse))
    if verdict.good:
        wander.level = verdict.level
    return _WordJudgement(verdict, wander.own(ticks), stream.ticks_in_recorded(ticks))


def _timed(follow: SignalTracker, stream: Stream, heard: _WordJudgement) -> Word | None:
    """Return the word with its exact start; None if the edge fit does not converge."""
    good = heard.verdict.good
    label, known = follow.label(good)
    verdict = follow.labels.bits(label, good)
    upheld = known and follow.upheld(good)
    fit = _fitted(follow, stream, heard, verdict)
    if fit.settled and good and follow.wander is None and follow.swings(fit):
        wander = Wander.about(follow.reverse, stream.in_recorded(fit.grid), stream, verdict.level)
        tracked = _track(follow, wander, stream)
        again = _fitted(follow, stream, tracked, verdict)
        if tracked.verdict.good and again.settled:  # the speed has begun to change
            follow.wander, heard, fit = wander, tracked, again
    if not fit.settled:
        return None
    ticks = stream.ticks_in_recorded(fit.ticks)
    if good and follow.wander is not None and heard.tracked is not None:
        follow.wander.own(heard.tracked)[:] = ticks
    follow.hit(fit, stream.in_recorded(fit.grid), good, heard.tracked)
    bit_0 = -1 if follow.reverse else 0
    return Word(
        timecode=with_rate(label, follow.rate(stream.sample_rate)),
        start=float(ticks[bit_0]),
        std=math.sqrt(fit.variance[bit_0]) / stream.up,
        cell=follow.grid.cell,
        reverse=follow.reverse,
        user_bits=follow.labels.user.value,
        known=known,
        sure=good,
        upheld=upheld,
        end=float(ticks[-1]),
        signal=follow.signal,
    )


def _fitted(follow: SignalTracker, stream: Stream, heard: _WordJudgement, verdict: LabelScore) -> EdgeFit:
    """Fit the edges of a word with the bits of a verdict, about the position where it was judged."""
    signs = np.ascontiguousarray(verdict.signs[:: -1 if follow.reverse else 1])
    terms = EVEN if heard.tracked is None else SWINGING
    return fit_edges(stream.sums, heard.ticks, signs, verdict.level, terms)
