"""Where words begin and the next is predicted, by the words so far, at constant or changing speed.

At constant speed the length of a cell comes from a line through the last words, and a word itself gives
only its middle. If the speed changes, a word begins half-way between two middles, on the cubic through both
with the speeds there. The distance of words from a smooth curve shows errors that their edges do not show.
"""
from __future__ import annotations

import math
from collections import deque

import numpy as np

from panoptic_ros.timecode.follow.lines import curve_excess, line_fit
from panoptic_ros.timecode.signal.grid import Grid, moved_grid
from panoptic_ros.timecode.word.fit import WordFit
from panoptic_ros.timecode.word.fit_kernels import widest_gap
from panoptic_ros.timecode.word.layout import WORD_CELLS

Array = np.ndarray
LEAST_STD = 0.00005  # samples; no sampler is better
BENDING = 0.05  # cells about a line: the speed then changes within a word
FEW_WORDS = 6  # fewer do not tell a curve from scatter
CURVED = 20.0  # variance ratio of what a cubic explains beyond a line, and of its scatter
SPREAD = 4e-4  # samples squared, about a line at constant speed
LINE_WORDS = 10  # through whose middles the line goes that gives the length of a cell
MOST_TURN = 1e-4  # of the bend from word to word
HALF = 0.5 * WORD_CELLS
PRIOR_WORDS = 6.0  # that the stated unseen error of a fit is worth
LONG_WORDS = 48  # about a parabola: slow errors are seen only over many words
HERMITE, BEYOND = 3.0 / 256.0, 1.0 / 3.0  # variance of a start, over that of middles by their neighbours


class Pace:
    """The pace of one signal.

    Args:
        line: length of a cell and its deviation if they are known from later words.
    """

    def __init__(self, reverse: bool, bending: bool, line: tuple[float, float] | None = None):
        self.bending = bending
        self.reverse = reverse
        self._fits: deque[tuple[int, WordFit]] = deque(maxlen=3)  # of the last words, with numbers
        self._words = np.empty((4, 0))  # the last ones, see `line_fit`
        self._on_line = 0  # of them in a row
        self._early_line = line
        self._line: tuple[float, float] | None = line
        self._astray = 0.0  # cells, of the last words about a line
        self._steady = True
        self._bend = -10, 0.0  # word and its bend
        self._edges: deque[float] = deque(maxlen=15)  # variance by batches of edges over that of white noise
        self._scale = 1.0  # the middle one
        self._turns: deque[float] = deque(maxlen=10)  # squared, samples: middles against their neighbours

    @property
    def straight(self) -> bool:
        """Whether the words lie on a line."""
        return self._line is not None

    def take(self, number: int, fit: WordFit) -> tuple[float, float, Grid]:
        """A word was read: start of bit 0 and its standard deviation; the grid of the next word."""
        white = max(fit.covariance[0, 0], 1e-12)
        self._edges.append(fit.observed[0, 0] / white)
        self._scale = sorted(self._edges)[len(self._edges) // 2]
        scale = max(self._scale, self._edges[-1]) if fit.clicked else self._scale
        self._fits.append((number, fit))
        words = np.empty((4, min(self._words.shape[1] + 1, LONG_WORDS)))
        words[:, :-1] = self._words[:, 1 - words.shape[1] :] if words.shape[1] > 1 else 0.0
        words[:, -1] = number, fit.middle, white, fit.unseen**2
        self._words = words
        self._line = self._find_line()
        if self._line is not None or words.shape[1] > 2:
            self.bending = self._line is None
        self._on_line = 0 if self._line is None else min(self._on_line + 1, LONG_WORDS)
        side = HALF if self.reverse else -HALF
        if self._line is not None:
            cell, cell_std = self._line
            variance = white * scale + (side * cell_std) ** 2 + self._hidden(fit)
            following = Grid(fit.middle + WORD_CELLS * cell, cell, 0.0)
            return fit.middle + side * cell, _std(variance), following
        edge, variance = self._between(number, fit, side, scale)
        return edge, _std(variance + fit.unseen**2), self._advance(number, fit)

    def passed(self, grid: Grid, fit: WordFit) -> tuple[float, float]:
        """The start and its deviation of a word that clicks may have shifted: nothing is learnt from it."""
        side = HALF if self.reverse else -HALF
        edge = moved_grid(grid._replace(middle=fit.middle), side).middle
        scale = max(1.0, self._scale, fit.observed[0, 0] / max(fit.covariance[0, 0], 1e-12))
        return edge, _std(scale * (fit.covariance[0, 0] + HALF**2 * fit.covariance[1, 1]) + self._hidden(fit))

    def early(self, grid: Grid, number: int) -> tuple[Grid, tuple[float, float] | None]:
        """The grid of an earlier word and the line, by the speed that is known by now."""
        if self._line is None or self.bending or not self._steady:
            return grid, None
        last, fit = self._fits[-1]
        back = fit.middle - (last - number) * WORD_CELLS * self._line[0]
        return Grid(back, self._line[0], 0.0), self._line

    def _hidden(self, fit: WordFit) -> float:
        """Variance that the edges of a word do not show: by its fit, and by how words scatter about a curve.

        Words whose edges lie alike between samples share an error. So what the fit states counts until words
        have covered most places between samples. Only then may the scatter about a curve reduce it.
        """
        freedom = max(0, self._on_line - 3)
        if not freedom:
            return fit.unseen**2
        words = np.ascontiguousarray(self._words[:, -self._on_line :])
        covered = freedom * max(0.0, 1.0 - 2.0 * widest_gap(words[1], fit.gap) / fit.gap)
        excess = curve_excess(words, self._scale)
        share = (freedom if excess > 0.0 else covered) / (PRIOR_WORDS + freedom)
        least = -0.9 * self._scale * fit.covariance[0, 0]
        variance: float = PRIOR_WORDS / (PRIOR_WORDS + covered) * fit.unseen**2 + max(least, share * excess)
        return variance

    def _find_line(self) -> tuple[float, float] | None:
        """Length of a cell and its deviation by the line through the last words, if they lie on one."""
        count = min(self._words.shape[1], LINE_WORDS)
        if self._early_line is not None and count < LINE_WORDS:
            return self._early_line
        if count < 3:
            return None
        line = line_fit(np.ascontiguousarray(self._words[:, -count:]))
        slope, spread = line.slope, line.square
        self._astray = math.sqrt(spread) / slope * WORD_CELLS
        expected = max(self._scale * line.shown + line.unseen, 1e-6)
        curved = count < FEW_WORDS or line.ratio > CURVED or self._astray > BENDING
        if spread > 9.0 * expected + SPREAD and curved:  # the speed changes
            self._steady = False
            return None
        return slope / WORD_CELLS, math.sqrt(max(spread, expected) / line.norm) / WORD_CELLS

    def _between(self, number: int, fit: WordFit, side: float, scale: float) -> tuple[float, float]:
        """Start and variance while the speed changes."""
        words = self._fits
        if len(words) > 2 and words[-2][0] == number - 1 and words[-3][0] == number - 2:
            away = words[-2][1].middle - _middle_of(words[-3][1], fit, 2.0)
            self._turns.append(away * away)
        if not self.reverse and len(words) > 1 and words[-2][0] == number - 1:
            before = words[-2][1]
            middles = 0.25 * (before.covariance[0, 0] + fit.covariance[0, 0])
            cells = (WORD_CELLS / 8.0) ** 2 * (before.covariance[1, 1] + fit.covariance[1, 1])
            return _middle_of(before, fit, 1.0), scale * (middles + cells) + HERMITE * self._rough
        gradient = np.array([1.0, side * (1.0 + fit.bend * side), fit.cell * side * side])
        variance = float(gradient @ fit.covariance @ gradient)
        return moved_grid(fit.grid, side).middle, scale * variance + BEYOND * self._rough

    @property
    def _rough(self) -> float:
        """Mean squared distance of middles from the curve through their neighbours."""
        return sum(self._turns) / len(self._turns) if self._turns else 0.0

    def _advance(self, number: int, fit: WordFit) -> Grid:
        """The grid of the next word while the speed changes; its change is extrapolated as well."""
        before, bend = self._bend
        self._bend = number, fit.bend
        if not self.bending:
            return moved_grid(Grid(fit.middle, fit.cell, 0.0), float(WORD_CELLS))
        turn = fit.bend - bend if before == number - 1 else 0.0
        cubic = float(np.clip(turn, -MOST_TURN, MOST_TURN)) / (3.0 * WORD_CELLS)
        u = float(WORD_CELLS)
        stretch = 1.0 + 2.0 * fit.bend * u + 3.0 * cubic * u * u
        middle = fit.middle + fit.cell * (u + fit.bend * u * u + cubic * u**3)
        return Grid(middle, fit.cell * stretch, (fit.bend + 3.0 * cubic * u) / stretch)


def _middle_of(before: WordFit, after: WordFit, words: float) -> float:
    """Half-way between the middles of two words on the cubic through both with their speeds."""
    turn = words * WORD_CELLS / 8.0 * (before.cell - after.cell)
    return 0.5 * (before.middle + after.middle) + turn


def _std(variance: float) -> float:
    return math.sqrt(variance + LEAST_STD**2)
