"""Reading the next word of a signal that is followed: its bits by its label, and its exact start."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import Timecode
from panoptic_ros.timecode.follow.following import Follow
from panoptic_ros.timecode.follow.wander import Wander
from panoptic_ros.timecode.label.evidence import Verdict
from panoptic_ros.timecode.label.rates import with_rate
from panoptic_ros.timecode.signal.edge_shape import EdgeShape
from panoptic_ros.timecode.signal.grid import Grid, moved_grid
from panoptic_ros.timecode.signal.stream import Stream
from panoptic_ros.timecode.word.bit_clock import drawn_grid, nearby_grid
from panoptic_ros.timecode.word.fit import WordFit, fit_free_edges, fit_word
from panoptic_ros.timecode.word.layout import SYNC, WORD_CELLS
from panoptic_ros.timecode.word.levels import ticks_levels, word_levels

Array = np.ndarray
SLACK = 2.0  # cells, that a word may end later than its beginning says if the speed changes
NEAR = 0.02  # cells, of where a word is expected that needs no look at its edges before it is fitted


@dataclass(frozen=True, slots=True)
class Word:
    """A word that was read.

    Args:
        timecode: its label, with the rate that is most likely so far.
        start: first edge of bit 0, samples since the stream's start; at the word's end in reverse.
        std: standard deviation of `start`.
        cell: length of a cell, samples.
        known: whether no other label is about as likely.
        sure: whether nothing contradicts the word.
        upheld: whether it and those before have their labels; if not, a word that is so must follow.
        number: of the word in its signal.
        bits, grid: (80,) in the order of the stream; as fitted.
        ticks: (193,) of the half cells if the speed changes within words, see `Wander.listen`.
        shape: of a step, as learnt from the signal so far.
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
    number: int
    bits: Array
    grid: Grid
    ticks: Array | None
    shape: EdgeShape


def word_complete(follow: Follow, stream: Stream) -> bool:
    """Whether all samples of the next word are there."""
    after = len(SYNC) if follow.reverse else 1.0  # cells that are listened to
    if follow.wander is not None:
        after += SLACK
    return stream.holds(moved_grid(follow.grid, 0.5 * WORD_CELLS + after).middle)


def read_word(follow: Follow, stream: Stream) -> Word | None:
    """Read the next word; None if it is missed. The signal is then followed to the word after it."""
    heard = _listen(follow, stream)
    word = _timed(follow, stream, heard) if heard.verdict.possible else None
    if word is None:
        follow.miss(heard.ticks)
    return word


class _Heard(NamedTuple):
    """A word that was judged.

    Args:
        grid: on the running sum.
        expected: whether it is good where it was expected.
        ticks: (193,) recorded samples, if it was tracked.
    """

    grid: Grid
    verdict: Verdict
    expected: bool
    ticks: Array | None = None


def _listen(follow: Follow, stream: Stream) -> _Heard:
    """Judge the word where it is expected and, if it does not fit its label there, near by."""
    if follow.wander is not None:
        return _track(follow, follow.wander, stream)
    sums, reverse = stream.sums, follow.reverse
    grid = stream.in_sums(follow.grid)
    levels = word_levels(sums, grid, reverse)
    verdict = follow.judge(levels)
    expected = verdict.good and follow.straight
    if verdict.good and not follow.misses:
        return _Heard(grid, verdict, expected)
    # After a miss good words are looked for as well: a grid that slips may fit labels that were not sent.
    moved = nearby_grid(sums, grid)
    second = follow.judge(word_levels(sums, moved, reverse))
    if verdict.good and second.level < verdict.level:  # noise has moved it away
        return _Heard(grid, follow.judge(levels), expected)
    return _Heard(moved, second, expected)


def _track(follow: Follow, wander: Wander, stream: Stream) -> _Heard:
    """Judge the word on half cells that are tracked."""
    ticks = wander.listen(stream)
    verdict = follow.judge(ticks_levels(stream.sums, ticks, follow.reverse))
    if verdict.good:
        wander.level = verdict.level
    return _Heard(stream.in_sums(follow.grid), verdict, False, stream.ticks_in_recorded(ticks))


def _timed(follow: Follow, stream: Stream, heard: _Heard) -> Word | None:
    """The word with its exact start; None if the fit does not settle."""
    good = heard.verdict.good
    label, known = follow.label(good)
    verdict = follow.labels.bits(label, good)
    upheld = known and follow.upheld(good)
    learns, number = good and follow.learns(verdict.share), follow.number
    bits, fit = _fitted(follow, stream, heard, verdict)
    timed = None if fit is None else follow.hit(fit, good, heard.ticks)
    if timed is None and fit is not None:  # the speed has begun to change
        wander = Wander.about(follow.reverse, fit.grid, stream, verdict.level)
        follow.wanders(wander)
        heard = _track(follow, wander, stream)
        bits, fit = _fitted(follow, stream, heard, verdict) if heard.verdict.good else (bits, None)
        timed = None if fit is None else follow.hit(fit, good, heard.ticks)
        if timed is None:
            follow.wanders(None)
    if fit is None or timed is None:
        return None
    if learns:
        fit.teach(follow.shape, stream.sample_rate)
    start, std = timed
    return Word(
        timecode=with_rate(label, follow.rate(stream.sample_rate)),
        start=start,
        std=std,
        cell=follow.grid.cell,
        reverse=follow.reverse,
        user_bits=follow.labels.user.value,
        known=known,
        sure=good,
        upheld=upheld,
        number=number,
        bits=bits,
        grid=fit.grid,
        ticks=heard.ticks,
        shape=follow.shape,
    )


def _fitted(follow: Follow, stream: Stream, heard: _Heard, verdict: Verdict) -> tuple[Array, WordFit | None]:
    """The bits in the order of the stream and their fit: about the expected place, or about the edges."""
    forward = slice(None, None, -1 if follow.reverse else 1)
    bits = verdict.bits[forward]
    if heard.ticks is not None and follow.wander is not None:
        wander, rate = follow.wander, stream.sample_rate
        before = wander.before(follow.number, heard.ticks)
        own = wander.own(heard.ticks)
        return bits, fit_free_edges(stream.recorded, bits, own, rate, follow.shape, before)
    fit = _fit(follow, stream, bits, follow.grid) if heard.expected else None
    if fit is None or abs(fit.middle - follow.grid.middle) > NEAR * fit.cell:
        signs = np.ascontiguousarray(verdict.signs[forward])
        grid = drawn_grid(stream.sums, heard.grid, signs, verdict.level)
        fit = _fit(follow, stream, bits, stream.in_recorded(grid))
    return bits, fit


def _fit(follow: Follow, stream: Stream, bits: Array, grid: Grid) -> WordFit | None:
    """The word with these bits near a grid of recorded samples."""
    return fit_word(stream.recorded, bits, grid, stream.sample_rate, follow.shape)
