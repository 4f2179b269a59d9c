"""A signal that is followed word by word: where the next begins, and which labels it may have.

At constant speed the length of a cell comes from a line through the middles of the last words. If the edges
of words swing about a line, the speed changes within words. These are then tracked edge by edge (`wander`)
until they have been on a line for long.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from panoptic_ros.domain import FrameRate, Timecode
from panoptic_ros.timecode.follow.wander import Wander
from panoptic_ros.timecode.label.evidence import Verdict
from panoptic_ros.timecode.label.expected import ExpectedLabels
from panoptic_ros.timecode.signal.half_cells import Grid, moved_grid
from panoptic_ros.timecode.word.edges import EdgeFit
from panoptic_ros.timecode.word.layout import WORD_CELLS
from panoptic_ros.timecode.word.viterbi import WordLevels

Array = np.ndarray
LINE_WORDS = 10  # through whose middles the line goes that gives the length of a cell
BENDING = 0.05  # cells by which a word is off that line: the speed has changed since
WAVERS = 30.0  # variance ratio of a swing in a word, more than any channel makes
OFTEN_WAVERS, FEW = 3.0, 8  # the same as a mean of a few words
LEAST_SWING = 4e-4  # samples squared, mean over the edges of a word; less is no swing
CALM_WORDS, CALM = 48, 1.5  # words with such a mean ratio, until the speed counts as constant


class Follow:
    """A signal that was found.

    Args:
        grid: of the word with `number`, in recorded samples.
        labels: that the words may have.
        reverse: whether the tape runs backwards.
        wander: the motion of the tape if its speed changes within words.

    Attributes:
        grid, number: of the next word.
        read: good words.
        misses: words in a row that were not.
        first: number and middle of the first word that was read, None before.
        signal: number of the signal in its stream.
    """

    def __init__(
        self, grid: Grid, number: int, labels: ExpectedLabels, reverse: bool, wander: Wander | None = None
    ):
        self.grid, self.number = grid, number
        self.labels, self.reverse, self.wander = labels, reverse, wander
        self.misses = self.read = self.signal = 0
        self.first: tuple[int, float] | None = None
        self._line: deque[tuple[int, float]] = deque(maxlen=LINE_WORDS)  # the same of the last words
        self._wavers: deque[float] = deque(maxlen=CALM_WORDS)  # variance ratios of swings, 1 if small
        self._scatter = 0.0  # sum over the words that were read

    @property
    def early(self) -> bool:
        """Whether the next word is before those that the signal was found by, perhaps before the signal."""
        return self.number < self.labels.first

    @property
    def scatter(self) -> float:
        """Mean variance of edges about the curve through their word, squared samples."""
        return self._scatter / self.read if self.read else math.inf

    def judge(self, levels: WordLevels) -> Verdict:
        """The next word against the most likely label."""
        return self.labels.judge(self.number, levels)

    def label(self, good: bool) -> tuple[Timecode, bool]:
        """The label of the word that was judged last, and whether it is known for sure."""
        label, known = self.labels.label(good)
        return label, known and (good or self.first is not None)

    def upheld(self, good: bool) -> bool:
        """Whether the words up to the one judged last have none of the labels beside theirs."""
        return self.labels.upheld(good, self.early, self.read)

    def rate(self, sample_rate: int) -> FrameRate:
        """The rate of those still possible whose words are as long as the ones heard."""
        length = WORD_CELLS * self.grid.cell
        if self.first is not None and self.number > self.first[0] + 2:
            length = (self.grid.middle - self.first[1]) / (self.number - self.first[0])
        return self.labels.rate(sample_rate / length)

    def swings(self, fit: EdgeFit) -> bool:
        """Whether the edges of the last words swing about a line, by more than samples and channels make."""
        few = [*self._wavers, _waver(fit)][-FEW:]
        return few[-1] > WAVERS or (len(few) == FEW and sum(few) > OFTEN_WAVERS * FEW)

    def miss(self, ticks: Array | None) -> None:
        """The word could not be read; the next is expected where it would be.

        Args:
            ticks: (193,) recorded samples, if it was tracked.
        """
        if self.early:
            self.labels.begin()
            self.first = None
        else:
            self.misses += 1
        self._advance(self.grid, ticks)

    def hit(self, fit: EdgeFit, grid: Grid, good: bool, ticks: Array | None) -> None:
        """The word was read; go on to the next. Nothing is learnt from a word that clicks may have shifted.

        Args:
            grid: of the word, recorded samples.
            ticks: see `miss`.
        """
        if not good:
            self.misses += not self.early
            self._advance(self.grid, ticks)
            return
        self.misses = 0
        self.read += 1
        self._scatter += fit.scatter
        self._wavers.append(_waver(fit))
        if self.first is None:
            self.first = self.number, grid.middle
        if abs(grid.middle - self.grid.middle) > BENDING * grid.cell:
            while len(self._line) > 1:
                self._line.popleft()
        self._line.append((self.number, grid.middle))
        self._advance(Grid(grid.middle, self.cell or grid.cell), ticks)
        if len(self._wavers) == CALM_WORDS and sum(self._wavers) < CALM * CALM_WORDS:
            self.wander = None

    @property
    def cell(self) -> float:
        """Length of a cell by the line through the last words, recorded samples; 0 if there are too few."""
        if len(self._line) < 3:
            return 0.0
        numbers, middles = np.array(self._line).T
        away = numbers - numbers.mean()
        return float(away @ middles / (away @ away)) / WORD_CELLS

    def _advance(self, grid: Grid, ticks: Array | None) -> None:
        """Go on to the next word from the grid of this one, or from its ticks if it was tracked."""
        self.grid = moved_grid(grid, float(WORD_CELLS))
        self.number += 1
        if self.wander is not None and ticks is not None:
            self.wander.skip(ticks)
            self.grid = self.wander.grid


def _waver(fit: EdgeFit) -> float:
    """How much the edges of a word swing about a line, 1 if hardly."""
    return fit.waver if fit.swing > LEAST_SWING else 1.0
