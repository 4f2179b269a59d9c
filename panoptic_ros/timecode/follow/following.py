"""State of a signal that is followed word by word: start and possible labels of the next word.

At constant speed, a line through the middles of the last words gives the cell length. If the edges of words
swing about a line, the speed changes within words. Words are then tracked edge by edge (`wander`) until their
edges have been on a line for `CALM_WORDS` words.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from panoptic_ros.domain import FrameRate, Timecode
from panoptic_ros.timecode.follow.wander import Wander
from panoptic_ros.timecode.label.evidence import LabelScore
from panoptic_ros.timecode.label.expected import ExpectedLabels
from panoptic_ros.timecode.signal.half_cells import CellGrid, moved_grid
from panoptic_ros.timecode.word.edges import EdgeFit
from panoptic_ros.timecode.word.layout import WORD_CELLS
from panoptic_ros.timecode.word.viterbi import WordLevels

Array = np.ndarray
LINE_WORDS = 10  # number of words in the line fit of the cell length
BENDING = 0.05  # cells; if a word is farther off the predicted middle, the speed has changed
# variance ratio of the swing in one word that shows a changing speed; no channel causes as much
WAVERS = 30.0
# mean variance ratio over a few words that shows a changing speed; number of words
OFTEN_WAVERS, FEW = 3.0, 8
LEAST_SWING = 4e-4  # samples squared, mean over the edges of a word; a smaller swing is ignored
# number of words and maximum mean variance ratio at which the speed is treated as constant again
CALM_WORDS, CALM = 48, 1.5


class SignalTracker:
    """State of a signal that is followed.

    Args:
        grid: grid of word `number`, recorded samples.
        labels: labels that the words may have.
        reverse: True if the tape runs backwards.
        wander: motion of the tape if its speed changes within words, else None.

    Attributes:
        grid, number: grid and number of the next word.
        read: number of good words so far.
        misses: number of consecutive words that were not good.
        first: (number, middle) of the first word read; None before.
        signal: number of the signal in its stream.
    """

    def __init__(
        self, grid: CellGrid, number: int, labels: ExpectedLabels, reverse: bool, wander: Wander | None = None
    ):
        self.grid, self.number = grid, number
        self.labels, self.reverse, self.wander = labels, reverse, wander
        self.misses = self.read = self.signal = 0
        self.first: tuple[int, float] | None = None
        self._line: deque[tuple[int, float]] = deque(maxlen=LINE_WORDS)  # number and middle of the last words
        # variance ratios of the swing; 1 if the swing is small
        self._wavers: deque[float] = deque(maxlen=CALM_WORDS)
        self._scatter = 0.0  # sum over the words read

    @property
    def early(self) -> bool:
        """Return whether the next word precedes the words by which the signal was found.

        Such a word may even precede the signal itself.
        """
        return self.number < self.labels.first

    @property
    def scatter(self) -> float:
        """Return the mean variance of edges about the fitted curve of their word, samples squared."""
        return self._scatter / self.read if self.read else math.inf

    def judge(self, levels: WordLevels) -> LabelScore:
        """Score the next word against its most likely label."""
        return self.labels.judge(self.number, levels)

    def label(self, good: bool) -> tuple[Timecode, bool]:
        """Return the label of the word judged last, and whether it is certain."""
        label, known = self.labels.label(good)
        return label, known and (good or self.first is not None)

    def upheld(self, good: bool) -> bool:
        """Return whether the words up to the one judged last have none of the neighbouring labels."""
        return self.labels.upheld(good, self.early, self.read)

    def rate(self, sample_rate: int) -> FrameRate:
        """Return the possible frame rate that best matches the measured word length."""
        length = WORD_CELLS * self.grid.cell
        if self.first is not None and self.number > self.first[0] + 2:
            length = (self.grid.middle - self.first[1]) / (self.number - self.first[0])
        return self.labels.rate(sample_rate / length)

    def swings(self, fit: EdgeFit) -> bool:
        """Return whether the edges of the last words swing about a line.

        The swing must be larger than sampling and channels can cause.
        """
        few = [*self._wavers, _waver(fit)][-FEW:]
        return few[-1] > WAVERS or (len(few) == FEW and sum(few) > OFTEN_WAVERS * FEW)

    def miss(self, ticks: Array | None) -> None:
        """Advance past a word that could not be read.

        The position of the next word is predicted from the expected position of the missed word.

        Args:
            ticks: (193,) positions of the word's ticks in recorded samples, if the word was tracked.
        """
        if self.early:
            self.labels.begin()
            self.first = None
        else:
            self.misses += 1
        self._advance(self.grid, ticks)

    def hit(self, fit: EdgeFit, grid: CellGrid, good: bool, ticks: Array | None) -> None:
        """Advance past a word that was read, and update the speed from it if it is good.

        A word that is not good may be shifted by clicks, so the speed is not updated from it.

        Args:
            grid: grid of the word, recorded samples.
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
        self._advance(CellGrid(grid.middle, self.cell or grid.cell), ticks)
        if len(self._wavers) == CALM_WORDS and sum(self._wavers) < CALM * CALM_WORDS:
            self.wander = None

    @property
    def cell(self) -> float:
        """Return the cell length (recorded samples) from a line through the last words; 0 before 3 words."""
        if len(self._line) < 3:
            return 0.0
        numbers, middles = np.array(self._line).T
        away = numbers - numbers.mean()
        return float(away @ middles / (away @ away)) / WORD_CELLS

    def _advance(self, grid: CellGrid, ticks: Array | None) -> None:
        """Advance to the next word from the grid of this word, or from its ticks if it was tracked."""
        self.grid = moved_grid(grid, float(WORD_CELLS))
        self.number += 1
        if self.wander is not None and ticks is not None:
            self.wander.skip(ticks)
            self.grid = self.wander.grid


def _waver(fit: EdgeFit) -> float:
    """Return the variance ratio of the swing of a word's edges about a line; 1 for a negligible swing."""
    return fit.waver if fit.swing > LEAST_SWING else 1.0
