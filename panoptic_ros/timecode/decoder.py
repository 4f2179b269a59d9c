"""One device's stream of samples to words: search, follow, lose, search again.

Samples are worked on in hops of fixed length, so the words do not depend on how the stream was cut
into blocks. While words are followed, each is read where the line through the last ones expects it.
Nothing is kept that noise could poison: after `lost_words` unreadable words all is forgotten.
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.timecode.acquisition import WINDOW_SECONDS, acquire
from panoptic_ros.timecode.cells import decide_bits, half_cells, integrate
from panoptic_ros.timecode.conditioning import Conditioner
from panoptic_ros.timecode.config import TimecodeConfig
from panoptic_ros.timecode.timing import WordFit, fit_word
from panoptic_ros.timecode.words import WORD_CELLS, Label, parse_word

Array = np.ndarray
HOP_SECONDS = 0.1
KEPT_SECONDS = 0.3  # of samples while words are followed
EARLY = 0.3  # cells that may be missing of the first word of a stream
EARLY_WORDS = 12  # that may be missed before the first is read
LEAST_STD = 0.003  # samples; no sampler is better
LINE_WORDS = 10  # through whose middles the line goes that gives the length of a cell
LEAST_QUALITY = 0.8  # share of the levels that the bits explain
LEAST_LEVEL = 0.35  # of each tenth of a word, of the word's level: a cut word has less
SHIFTS = np.linspace(-0.2, 0.2, 17)  # cells, about the expected start of a word
STRETCHES = np.linspace(-0.004, 0.004, 5)  # relative, of the length of a cell


@dataclass(frozen=True, slots=True)
class Word:
    """A word that was read.

    Args:
        number: counts words of the signal, also unreadable ones; negative steps never happen.
        label: None if it could not be read.
        start: first edge of bit 0, samples since the stream's start; at the word's end in reverse.
        std: of `start`.
        cell: length of a cell, samples.
    """

    number: int
    label: Label | None
    start: float
    std: float
    cell: float
    reverse: bool


class LtcDecoder:
    """Words of one uninterrupted stream."""

    def __init__(self, config: TimecodeConfig, sample_rate: int):
        self._config = config
        self._rate = sample_rate
        self._hop = int(HOP_SECONDS * sample_rate)
        self._conditioner = Conditioner(sample_rate, config.high_pass_hz)
        self._up = self._conditioner.up  # conditioned samples per raw one
        self._pending = np.zeros(0)
        self._raw = np.zeros(0)
        self._signal = np.zeros(0)
        self._first = 0  # index of the first kept sample
        self._follow: _Follow | None = None
        self._read_until = -np.inf  # end of the last word that was handed out
        self._searches = 0

    def push(self, samples: Array) -> list[Word]:
        """Words that became complete."""
        self._pending = np.concatenate([self._pending, samples.astype(np.float64)])
        words = []
        while len(self._pending) >= self._hop:
            words += self._work(self._pending[: self._hop])
            self._pending = self._pending[self._hop :]
        return words

    def finish(self) -> list[Word]:
        """The words that end with the stream."""
        silence = np.zeros(self._conditioner.reach + self._hop)
        words = self._work(np.concatenate([self._pending, silence]), last=True)
        self._pending = np.zeros(0)
        return words

    def _work(self, samples: Array, last: bool = False) -> list[Word]:
        self._raw = np.concatenate([self._raw, samples])
        self._signal = np.concatenate([self._signal, self._conditioner.push(samples)])
        words = []
        sums = np.concatenate([[0.0], np.cumsum(self._signal)])
        while True:
            if self._follow is None and not self._search(sums, last):
                break
            word = self._next_word(sums)
            if word is None:
                break
            words.append(word)
            if self._follow is None:
                break  # lost: search in the next hop
        self._forget()
        return words

    def _search(self, sums: Array, last: bool) -> bool:
        """Look for a signal in every other hop."""
        self._searches += 1
        if self._searches % 2 and not last:
            return False
        window = int(WINDOW_SECONDS * self._rate * self._up)
        skipped = max(0, len(self._signal) - window)
        if not last and len(self._signal) < window:
            return False
        found = acquire(sums[skipped:] - sums[skipped], self._rate * self._up, self._config.speed_range)
        if found is None:
            return False
        start, cell = self._first + (skipped + found.word_start) / self._up, found.cell / self._up
        length = WORD_CELLS * cell
        earliest = max(self._first - EARLY * cell, self._read_until - 0.5 * cell)
        start -= length * np.floor((start - earliest) / length)  # also words before the window, if kept
        self._follow = _Follow(float(start), cell, found.reverse)
        return True

    def _next_word(self, sums: Array) -> Word | None:
        """The next word if it is complete."""
        follow = self._follow
        assert follow is not None
        end = self._first + len(self._signal) // self._up
        if follow.start + (WORD_CELLS + 1.0) * follow.cell > end:
            return None
        start, cell = _align(sums, (follow.start - self._first) * self._up, follow.cell * self._up)
        halves = half_cells(sums, start, cell, WORD_CELLS)
        bits, quality = decide_bits(halves)
        label = parse_word(bits[::-1] if follow.reverse else bits)
        fit = None
        if label is not None and quality >= LEAST_QUALITY and _present(halves):
            place = self._first + start / self._up
            fit = fit_word(self._raw, self._first, bits, place, cell / self._up, self._rate)
        if fit is None:
            word = Word(follow.number, None, follow.start, np.inf, follow.cell, follow.reverse)
            follow.miss()
            if follow.lost(self._config.lost_words):
                self._follow = None
            return word
        number = follow.number
        start, std = follow.hit(fit)
        self._read_until = follow.start
        edge = start + WORD_CELLS * follow.cell if follow.reverse else start
        return Word(number, label, edge, std, follow.cell, follow.reverse)

    def _forget(self) -> None:
        """Drop the samples that nobody needs any more."""
        kept = WINDOW_SECONDS + HOP_SECONDS if self._follow is None else KEPT_SECONDS
        surplus = len(self._signal) // self._up - int(kept * self._rate)
        if surplus > 0:
            self._raw, self._signal = self._raw[surplus:], self._signal[surplus * self._up :]
            self._first += surplus


class _Follow:
    """Where the next word is expected."""

    def __init__(self, start: float, cell: float, reverse: bool):
        self.start, self.cell, self.reverse = start, cell, reverse
        self.number = 0
        self.misses = 0
        self._middles: list[tuple[int, float, float]] = []  # word number, middle, its variance

    def miss(self) -> None:
        """The word could not be read; the next is expected where it would be."""
        self.misses += 1
        self.start += WORD_CELLS * self.cell
        self.number += 1

    def lost(self, most: int) -> bool:
        """Whether the signal is gone; at first, words from before the signal may be missed."""
        return self.misses >= most + (0 if self._middles else EARLY_WORDS)

    def hit(self, fit: WordFit) -> tuple[float, float]:
        """The word was read: its start and standard deviation; moves on to the next."""
        self.misses = 0
        self._middles = [*self._middles, (self.number, fit.middle, fit.middle_std**2)][-LINE_WORDS:]
        self.cell, cell_std = self._cell(fit)
        half = 0.5 * WORD_CELLS
        start = fit.middle - half * self.cell
        self.start = fit.middle + half * self.cell
        self.number += 1
        return start, float(np.linalg.norm([fit.middle_std, half * cell_std, LEAST_STD]))

    def _cell(self, fit: WordFit) -> tuple[float, float]:
        """The length of a cell: that of the line through the last words if they lie on one."""
        if len(self._middles) < 3:
            return fit.cell, fit.cell_std
        number, middle, variance = np.array(self._middles).T
        x = number - number.mean()
        slope = float(x @ (middle - middle.mean()) / (x @ x))
        error = middle - middle.mean() - slope * x
        expected = max(float(variance.mean()), 1e-6)
        spread = float(error @ error) / (len(x) - 2)
        if spread > 9.0 * expected + 0.01:  # the speed changes: trust the word itself
            return fit.cell, fit.cell_std
        std = np.sqrt(max(spread, expected) / (x @ x)) / WORD_CELLS
        return slope / WORD_CELLS, float(std)


def _align(sums: Array, start: float, cell: float) -> tuple[float, float]:
    """Start and cell length near the expected ones with the largest energy of the half cells."""
    lengths = cell * (1.0 + STRETCHES)
    begins = start + cell * (SHIFTS[None, :] - 0.5 * WORD_CELLS * STRETCHES[:, None])
    bounds = begins[..., None] + 0.5 * lengths[:, None, None] * np.arange(2 * WORD_CELLS + 1)
    levels = np.diff(integrate(sums, bounds), axis=-1) / lengths[:, None, None]
    i, j = np.unravel_index(int(np.argmax((levels * levels).sum(axis=-1))), begins.shape)
    return float(begins[i, j]), float(lengths[i])


def _present(halves: Array) -> bool:
    """Whether every tenth of the word has signal."""
    tenths = np.abs(halves).reshape(10, -1).mean(axis=1)
    return bool(tenths.min() > LEAST_LEVEL * np.median(tenths))
