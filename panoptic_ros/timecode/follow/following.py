"""A signal that is followed word by word: where the next begins, and which labels it may have."""

from __future__ import annotations

import numpy as np

from panoptic_ros.domain import FrameRate, Timecode
from panoptic_ros.timecode.follow.pace import Pace
from panoptic_ros.timecode.follow.wander import Wander
from panoptic_ros.timecode.label.evidence import CLEAN_SHARE, Verdict
from panoptic_ros.timecode.label.expected import ExpectedLabels
from panoptic_ros.timecode.signal.edge_shape import EdgeShape
from panoptic_ros.timecode.signal.grid import Grid, moved_grid
from panoptic_ros.timecode.word.fit import WordFit
from panoptic_ros.timecode.word.layout import WORD_CELLS
from panoptic_ros.timecode.word.levels import WordLevels

Array = np.ndarray
LEARN_ALL, LEARN_MANY = 16, 50  # words; then every third, then every
RARELY = 30


class Follow:
    """A signal that was found.

    Args:
        grid: of the word with `number`, in recorded samples.
        labels: that the words may have.
        shape: of a step.

    Attributes:
        grid, number: of the next word.
        pace: where words begin.
        read: good words.
        misses: words in a row that were not.
    """

    def __init__(self, grid: Grid, number: int, labels: ExpectedLabels, pace: Pace, shape: EdgeShape):
        self.grid, self.number = grid, number
        self.labels = labels
        self.shape = shape
        self.misses = self.read = 0
        self.pace = pace
        self._first: tuple[int, float] | None = None  # number and middle of the first word that was read

    @property
    def reverse(self) -> bool:
        """Whether the tape runs backwards."""
        return self.pace.reverse

    @property
    def early(self) -> bool:
        """Whether the next word is before those that the signal was found by, perhaps before the signal."""
        return self.number < self.labels.first

    @property
    def wander(self) -> Wander | None:
        """The motion of the tape if its speed changes within words."""
        return self.pace.wander

    @property
    def straight(self) -> bool:
        """Whether the words so far lie on a line."""
        return self.pace.straight

    def judge(self, levels: WordLevels) -> Verdict:
        """The next word against the most likely label."""
        return self.labels.judge(self.number, levels)

    def label(self, good: bool) -> tuple[Timecode, bool]:
        """The label of the word that was judged last, and whether it is known for sure."""
        label, known = self.labels.label(good)
        return label, known and (good or self._first is not None)

    def upheld(self, good: bool) -> bool:
        """Whether the words up to the one judged last have none of the labels beside theirs."""
        return self.labels.upheld(good, self.early, self.read)

    def rate(self, sample_rate: int) -> FrameRate:
        """The rate of those still possible whose words are as long as the ones heard."""
        length = WORD_CELLS * self.grid.cell
        if self._first is not None and self.number > self._first[0] + 2:
            length = (self.grid.middle - self._first[1]) / (self.number - self._first[0])
        return self.labels.rate(sample_rate / length)

    def learns(self, share: float) -> bool:
        """Whether the next word should teach the shape of a step: most at first."""
        words = self.shape.words
        often = 1 if words < LEARN_ALL else 3 if words < LEARN_MANY else RARELY
        return share > CLEAN_SHARE and self.number % often == 0

    def miss(self, ticks: Array | None) -> None:
        """The word could not be read; the next is expected where it would be."""
        if self.early:
            self.labels.begin()
            self._first = None
        else:
            self.misses += 1
        wander = self.wander
        if wander is None or ticks is None:
            self._advance(moved_grid(self.grid, float(WORD_CELLS)))
            return
        wander.skip(ticks)
        self._advance(wander.grid)

    def hit(self, fit: WordFit, good: bool, ticks: Array | None) -> tuple[float, float] | None:
        """The word was read: the first edge of its bit 0 and the standard deviation; moves on.

        None if the speed has turned out to change: then the word must be tracked.

        Args:
            ticks: (193,) recorded samples, if it was tracked.
        """
        if not good:
            self.misses += not self.early
            edge, std, grid = self.pace.passed(self.grid, fit, ticks)
            self._advance(grid)
            return edge, std
        taken = self.pace.take(self.number, fit, ticks)
        if taken is None:
            return None
        self.misses = 0
        self.read += 1
        if self._first is None:
            self._first = self.number, fit.middle
        edge, std, grid = taken
        self._advance(grid)
        return edge, std

    def wanders(self, wander: Wander | None) -> None:
        """From the next word on, the speed is taken to change within words, or to be constant if None."""
        self.pace.wander = wander

    def _advance(self, grid: Grid) -> None:
        self.grid = grid
        self.number += 1
