"""One device's stream of samples to words: search, follow, lose, search again.

Samples are worked on in hops of fixed length, so the words do not depend on how the stream was cut
into blocks. While words are followed, each is judged where the line through the last ones expects it.
Nothing is kept that noise could poison: after `lost_words` unreadable words all is forgotten.
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.domain import Timecode
from panoptic_ros.timecode.acquisition import CHANGING, LONG, SHORT, Found, Search, acquire
from panoptic_ros.timecode.buffer import Buffer
from panoptic_ros.timecode.conditioning import Conditioner
from panoptic_ros.timecode.config import TimecodeConfig
from panoptic_ros.timecode.edge_shape import EdgeShape
from panoptic_ros.timecode.evidence import Verdict, judge
from panoptic_ros.timecode.following import Follow
from panoptic_ros.timecode.kernels import best_grid, drawn_grid, moved_grid
from panoptic_ros.timecode.labels import solve_labels
from panoptic_ros.timecode.levels import WordLevels, word_levels
from panoptic_ros.timecode.pace import Pace
from panoptic_ros.timecode.rates import with_rate
from panoptic_ros.timecode.timing import WordFit, fit_word
from panoptic_ros.timecode.words import SYNC, SYNC_ONLY, WORD_CELLS

Array = np.ndarray
HOP_SECONDS = 0.1
KEPT_SECONDS = 1.0  # of samples: a signal that is found late is read from there on
BUFFER_SECONDS = 4.0
EARLY = 0.3  # cells that may be missing of the first word of a stream
FARTHEST = 3  # words before the first that was found, where a changing speed may still be known
TURNS = ((SHORT, CHANGING), (LONG, CHANGING))  # what is looked for in successive hops
REHEARSALS = 2  # of the words heard so far: the first teaches the shape of edges, the other by it the speed
NEAR = 0.02  # cells, of where a word is expected that needs no look at its edges before it is fitted
SHIFTS = np.linspace(-0.3, 0.3, 13)  # cells, about the expected middle of a word
STRETCHES = np.linspace(-0.012, 0.012, 7)  # relative, of the length of a cell
BENDS = np.linspace(-1e-4, 1e-4, 3)


@dataclass(frozen=True, slots=True)
class Word:
    """A word that was read.

    Args:
        timecode: its label, with the rate that is most likely so far.
        start: first edge of bit 0, samples since the stream's start; at the word's end in reverse.
        std: of `start`.
        cell: length of a cell, samples.
        known: whether no other label is about as likely.
        sure: whether the word is good.
        upheld: whether it and those before have their labels; if not, a word that is so must follow.
        number: of the word in its signal.
        bits, grid: (80,) in the order of the stream; (3,) as fitted.
        bending: whether the speed changes.
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
    grid: Array
    bending: bool
    shape: EdgeShape


class LtcDecoder:
    """Words of one uninterrupted stream."""

    def __init__(self, config: TimecodeConfig, sample_rate: int):
        self._config = config
        self._rate = sample_rate
        self._hop = int(HOP_SECONDS * sample_rate)
        self._conditioner = Conditioner(sample_rate, config.high_pass_hz)
        self._up = self._conditioner.up  # conditioned samples per raw one
        self._pending: list[Array] = []
        self._pending_count = 0
        self._raw = Buffer(int(BUFFER_SECONDS * sample_rate))
        self._sums = Buffer(int(BUFFER_SECONDS * sample_rate) * self._up)
        self._sums.append(np.zeros(1))
        self._first = 0  # index of the first kept sample
        self._follow: Follow | None = None
        self._read_until = -np.inf  # end of the last word that was handed out
        self._held: list[Word] = []  # doubtful words that wait for a sure one
        self._searches = 0

    def push(self, samples: Array) -> list[Word]:
        """Words that became complete."""
        self._pending.append(samples)
        self._pending_count += len(samples)
        if self._pending_count < self._hop:
            return []
        joined = np.concatenate(self._pending).astype(np.float64)
        words: list[Word] = []
        first = 0
        while first + self._hop <= len(joined):
            words += self._work(joined[first : first + self._hop])
            first += self._hop
        self._pending, self._pending_count = [joined[first:]], len(joined) - first
        return words

    def finish(self) -> list[Word]:
        """The words that end with the stream."""
        silence = np.zeros(self._conditioner.reach + self._hop)
        words = self._work(np.concatenate([*self._pending, silence]), last=True)
        self._pending, self._pending_count = [], 0
        return words

    def _work(self, samples: Array, last: bool = False) -> list[Word]:
        self._raw.append(samples)
        signal = self._conditioner.push(samples)
        self._sums.append(np.cumsum(signal) + self._sums.values[-1])
        words: list[Word] = []
        while self._follow is not None or self._search(last):
            if not self._word_complete():
                break
            word = self._next_word()
            if word is not None:
                self._held.append(word)
                if word.upheld:  # those that it has counted on from are right
                    words += self._held
                    self._held = []
                    self._read_until = word.grid[0] + 0.5 * WORD_CELLS * word.grid[1]
            if self._follow is None:
                break  # lost: search in the next hop
        surplus = len(self._raw.values) - int(KEPT_SECONDS * self._rate)
        if surplus > 0:
            self._raw.drop(surplus)
            self._sums.drop(surplus * self._up)
            self._first += surplus
        return words

    def _search(self, last: bool) -> bool:
        """Look for a signal: soon after its start, through noise, with changing speed."""
        self._searches += 1
        kinds = (SHORT, LONG, CHANGING) if last else TURNS[self._searches % len(TURNS)]
        for search in kinds:
            for found in acquire(self._sums.values, self._rate * self._up, self._config.speed_range, search):
                if self._believe(found, search):
                    return True
        return False

    def _believe(self, found: Found, search: Search) -> bool:
        """Follow what was found if its words have labels that count on."""
        sums = self._sums.values
        grids = _chain(sums, found) if search.most_bend else _row(sums, found, search, self._rate * self._up)
        words = [word_levels(sums, grid, found.reverse) for grid in grids]
        solution = solve_labels(words, found.reverse, self._config.agreeing_words)
        if solution is None:
            return False
        grid, number = self._raw_grid(grids[0]), 0
        earliest = max(self._first - EARLY * grid[1], self._read_until - 0.5 * grid[1])
        while True:
            before = moved_grid(grid, -float(WORD_CELLS))
            if before[0] - 0.5 * WORD_CELLS * before[1] < earliest:
                break
            if search.most_bend and number == -FARTHEST:
                break
            grid, number = before, number - 1
        while grid[0] - 0.5 * WORD_CELLS * grid[1] < earliest:
            grid, number = moved_grid(grid, float(WORD_CELLS)), number + 1
        shape = EdgeShape(self._rate)
        for _ in range(REHEARSALS):
            pace = Pace(found.reverse, bool(search.most_bend))
            self._follow = follow = Follow(grid, number, found.reverse, solution, pace, shape)
            while self._follow is not None and self._word_complete():
                self._next_word()
        self._held = []
        if follow.read < self._config.agreeing_words:
            self._follow = None
            return False
        self._follow = follow.restart(grid, number, solution)
        return True

    def _raw_grid(self, grid: Array) -> Array:
        """From conditioned samples to samples since the stream's start."""
        return np.array([self._first + grid[0] / self._up, grid[1] / self._up, grid[2]])

    def _fine_grid(self, grid: Array) -> Array:
        """The other way."""
        return np.array([(grid[0] - self._first) * self._up, grid[1] * self._up, grid[2]])

    def _word_complete(self) -> bool:
        assert self._follow is not None
        after = len(SYNC) if self._follow.reverse else 1.0  # cells that are listened to
        end = moved_grid(self._follow.grid, 0.5 * WORD_CELLS + after)[0]
        return bool(end <= self._first + (len(self._sums.values) - 1) // self._up)

    def _next_word(self) -> Word | None:
        """Read the next word, or miss it."""
        follow, sums = self._follow, self._sums.values
        assert follow is not None
        grid = self._fine_grid(follow.grid)
        levels = word_levels(sums, grid, follow.reverse)
        verdict = follow.judge(levels)
        expected = verdict.good and follow.straight
        if not verdict.good or follow.misses:  # a grid that slips may fit labels that were not sent
            moved = best_grid(sums, grid, -0.5 * WORD_CELLS, WORD_CELLS, SHIFTS, STRETCHES, BENDS)
            again = word_levels(sums, moved, follow.reverse)
            second = follow.judge(again)
            if verdict.good and second.level < verdict.level:  # noise has moved it away
                verdict = follow.judge(levels)
            else:
                grid, levels, verdict = moved, again, second
        word = self._timed(grid, levels, verdict.good, expected) if verdict.possible else None
        if word is None:
            if follow.early:  # the words so far are of something else
                self._held = []
            follow.miss()
        if follow.misses >= self._config.lost_words:
            self._follow, self._held = None, []
        return word if word is not None and word.known else None

    def _timed(self, grid: Array, levels: WordLevels, good: bool, expected: bool) -> Word | None:
        """The word with its exact start."""
        follow = self._follow
        assert follow is not None
        label, known = follow.label(good)
        known = known and (good or follow.started)
        verdict = follow.bits(label, good)
        upheld = known and follow.upheld(good)
        forward = slice(None, None, -1 if follow.reverse else 1)
        bits = verdict.bits[forward]
        fit = self._fit(bits, follow.grid) if expected else None
        if fit is None or (expected and abs(fit.middle - follow.grid[0]) > NEAR * fit.cell):
            signs = np.ascontiguousarray(verdict.signs[forward])
            grid = drawn_grid(self._sums.values, grid, signs, verdict.level, 3 if follow.bending else 2)
            fit = self._fit(bits, self._raw_grid(grid))
        if fit is None:
            return None
        if good and follow.learns(verdict.share):
            fit.teach(follow.shape, self._rate)
        number, bending = follow.number, follow.bending
        start, std = follow.hit(fit, good)
        timecode = with_rate(label, follow.rate(self._rate))
        user_bits = follow.user.value
        return Word(
            timecode, start, std, follow.grid[1], follow.reverse, user_bits, known, good, upheld, number,
            bits, fit.grid, bending, follow.shape,
        )  # fmt: skip

    def _fit(self, bits: Array, grid: Array) -> WordFit | None:
        """The word with these bits near a grid of raw samples."""
        follow = self._follow
        assert follow is not None
        return fit_word(self._raw.values, self._first, bits, grid, self._rate, follow.shape, follow.bending)


def _row(sums: Array, found: Found, search: Search, rate: int) -> list[Array]:
    """The grids of the words of constant length in the newest part of the signal."""
    length = WORD_CELLS * found.grid[1]
    end = len(sums) - 1
    begin = end - search.seconds * rate
    first = -int((found.grid[0] - 0.5 * length - begin) / length)
    last = int((end - found.grid[0] - 0.5 * length) / length)
    return [moved_grid(found.grid, float(WORD_CELLS * k)) for k in range(first, last + 1)]


def _chain(sums: Array, found: Found) -> list[Array]:
    """The grids of the words that can be followed from one to the next, backwards and forwards."""
    grids: list[Array] = []
    for step in (-1, 1):
        grid = found.grid
        while True:
            drawn = _drawn(sums, grid, found.reverse)
            if drawn is None:
                break
            grids = [*grids, drawn] if step > 0 else [drawn, *grids]
            grid = moved_grid(drawn, step * float(WORD_CELLS))
        if step < 0:
            grids = grids[:-1]  # the word that was found comes again
    return grids


def _drawn(sums: Array, grid: Array, reverse: bool) -> Array | None:
    """The grid moved to a word's edges, if there is a word."""
    ends = [moved_grid(grid, side * (0.5 * WORD_CELLS + 0.5))[0] for side in (-1.0, 1.0)]
    if ends[0] < 0.0 or ends[1] > len(sums) - 1:
        return None
    for _ in range(2):
        verdict: Verdict = judge(word_levels(sums, grid, reverse), SYNC_ONLY)
        if not verdict.good:
            grid = best_grid(sums, grid, -0.5 * WORD_CELLS, WORD_CELLS, SHIFTS, STRETCHES, BENDS)
            verdict = judge(word_levels(sums, grid, reverse), SYNC_ONLY)
        if not verdict.good:
            return None
        signs = np.ascontiguousarray(verdict.signs[::-1]) if reverse else verdict.signs
        grid = drawn_grid(sums, grid, signs, verdict.level, 3)
    return grid
