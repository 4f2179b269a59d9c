"""Where words begin and the next is predicted, by the words so far.

At constant speed the length of a cell comes from a line through the last words, or a parabola as far as they
show one, and a word itself gives only its middle; the distance of words from a smooth curve shows errors that
their edges do not show. If edges swing about a line within a word, or words are off their line, the speed
changes and edges count one by one (`wander`), until they have been on a line for long.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from panoptic_ros.timecode.follow.lines import CellLine, cell_line, curve_excess, line_fit
from panoptic_ros.timecode.follow.wander import Wander
from panoptic_ros.timecode.signal.grid import Grid, moved_grid
from panoptic_ros.timecode.word.fit import WordFit
from panoptic_ros.timecode.word.layout import WORD_CELLS
from panoptic_ros.timecode.word.unseen_kernels import widest_gap

Array = np.ndarray
LEAST_STD = 0.00005  # samples; no sampler is better
LEAST_SHARE = 0.1  # of the variance by white noise, which words that scatter less are left with
BENDING = 0.05  # cells about a line: the speed then changes within a word
FEW_WORDS = 6  # fewer do not tell a curve from scatter
CURVED = 20.0  # variance ratio of what a cubic explains beyond a line, and of its scatter
SPREAD = 4e-4  # samples squared, about a line at constant speed
LINE_WORDS = 10  # through whose middles the line goes that gives the length of a cell
HALF = 0.5 * WORD_CELLS
PRIOR_WORDS = 6.0  # that the stated unseen error of a fit is worth
LONG_WORDS = 48  # about a parabola: slow errors are seen only over many words
WAVERS = 30.0  # variance ratio of a swing in a word, more than any channel makes
LOOSE_WAVERS, OFTEN_WAVERS, FEW = 8.0, 3.0, 8  # the same, and mean of a few, of words not quite on a line
LOOSE = 3.0  # times the variance that is expected about a line
CALM_WORDS, CALM = 90, 1.5  # words on a line until the speed counts as constant, with such a mean ratio
CALM_AT_FIRST = 2.5  # the same ratio of the words by which a signal was found


class Pace:
    """The pace of one signal.

    Args:
        line: length of a cell if it is known from later words.
        wander: where words begin if the speed changes.

    Attributes:
        wander: that; None at constant speed.
    """

    def __init__(self, reverse: bool, line: CellLine | None = None, wander: Wander | None = None):
        self.reverse = reverse
        self.wander = wander
        self._before: tuple[int, WordFit] | None = None  # the last word with its number
        self._words = np.empty((4, 0))  # the last ones, see `line_fit`
        self._on_line = 0  # of them in a row
        self._early_line = line
        self._line: CellLine | None = line
        self._astray = 0.0  # cells, of the last words about a line
        self._loose = False  # whether words are not quite on their line
        self._wavers: deque[float] = deque(maxlen=CALM_WORDS)  # variance ratios of swings, 1 if small
        self._edges: deque[float] = deque(maxlen=15)  # variance by batches of edges over that of white noise
        self._scale = 1.0  # the middle one

    @property
    def line(self) -> CellLine | None:
        """Length of a cell, at constant speed."""
        return self._line if self.wander is None else None

    @property
    def variance(self) -> float:
        """Mean variance of the last words' middles, squared samples."""
        if not self._words.shape[1]:
            return math.inf
        return float(np.mean(self._scale * self._words[2] + self._words[3]))

    @property
    def straight(self) -> bool:
        """Whether the words lie on a line."""
        return self.line is not None

    def take(self, number: int, fit: WordFit, ticks: Array | None) -> tuple[float, float, Grid] | None:
        """A word was read: start of bit 0 and its standard deviation; about where the next word is.

        None if the speed changes: then the word must be tracked and fitted edge by edge.

        Args:
            ticks: of the word if it was tracked.
        """
        self._remember(number, fit)
        self._line = self._find_line()
        off_line = self._line is None and self._words.shape[1] > 2
        self._on_line = 0 if self._line is None else min(self._on_line + 1, LONG_WORDS)
        if self.wander is not None and ticks is not None:
            edge, variance = self.wander.take(number, fit, ticks)
            grid = self.wander.grid
            if self._calm:
                self.wander = None
            return edge, std_of(variance), grid
        if off_line or self._swings():
            self._on_line = 0
            return None
        before, self._before = self._before, (number, fit)
        side = HALF if self.reverse else -HALF
        if self._line is not None:
            cell, turn = self._line.at(number), self._line.turn
            own, shared = self._variances(fit, self._noise(fit) * fit.covariance[0, 0])
            variance = self._line.variance_beside(number, side, own) + shared
            # a line through the edges of a parabola lies a sixth of its sagitta off its middle
            edge = fit.middle + side * cell + turn / WORD_CELLS * side**2 / 3.0
            grid = Grid(fit.middle + WORD_CELLS * (cell + 0.5 * turn), cell + turn)
            return edge, std_of(variance), grid
        edge, variance = self._by_two(before, number, fit, side)
        return edge, std_of(variance + fit.unseen**2), moved_grid(fit.grid, float(WORD_CELLS))

    def passed(self, grid: Grid, fit: WordFit, ticks: Array | None) -> tuple[float, float, Grid]:
        """The same for a word that clicks may have shifted: nothing is learnt from it."""
        if self.wander is not None and ticks is not None:
            edge, variance = self.wander.passed(fit, ticks)
            return edge, std_of(variance), self.wander.grid
        side = HALF if self.reverse else -HALF
        edge = moved_grid(grid._replace(middle=fit.middle), side).middle
        scale = max(1.0, self._scale, fit.observed[0, 0] / max(fit.covariance[0, 0], 1e-12))
        _, shared = self._variances(fit, scale * fit.covariance[0, 0])
        variance = scale * place_variance(fit, 1.0, side) + shared
        return edge, std_of(variance), moved_grid(grid, float(WORD_CELLS))

    def restarted(self, grid: Grid, number: int, wander: Wander | None) -> tuple[Grid, Pace]:
        """The pace from an earlier word on, by what is known by now, and the grid of that word.

        Args:
            wander: at that word, if the speed changed from there on.
        """
        if self._line is not None and sum(self._wavers) < CALM_AT_FIRST * len(self._wavers):
            last, middle = self._words[:2, -1]
            line = self._line.steady()
            back = middle - (last - number) * WORD_CELLS * line.cell
            return Grid(float(back), line.cell), Pace(self.reverse, line)
        if wander is None or self.wander is None:
            return grid, Pace(self.reverse)
        learnt = self.wander.again_at(wander)
        return learnt.grid, Pace(self.reverse, None, learnt)

    def _remember(self, number: int, fit: WordFit) -> None:
        """Keep a word; it may be known already by another fit."""
        if self._words.shape[1] and self._words[0, -1] == number:
            self._words = self._words[:, :-1]
            self._wavers.pop()
            self._edges.pop()
        white = max(fit.covariance[0, 0], 1e-12)
        self._edges.append(fit.observed[0, 0] / white)
        self._scale = sorted(self._edges)[len(self._edges) // 2]
        self._wavers.append(fit.waver if fit.swing > SPREAD else 1.0)
        words = np.empty((4, min(self._words.shape[1] + 1, LONG_WORDS)))
        words[:, :-1] = self._words[:, 1 - words.shape[1] :] if words.shape[1] > 1 else 0.0
        words[:, -1] = number, fit.middle, white, fit.unseen**2
        self._words = words

    def _noise(self, fit: WordFit) -> float:
        """Variance of edges over that by white noise."""
        return max(self._scale, self._edges[-1]) if fit.clicked else self._scale

    def _swings(self) -> bool:
        """Whether the edges of the last words swing about a line, by more than samples and shapes make.

        What a channel does to edges is alike in all words, so these stay on their line.
        """
        few = list(self._wavers)[-FEW:]
        often = few[-1] > LOOSE_WAVERS or (len(few) == FEW and sum(few) > OFTEN_WAVERS * FEW)
        return few[-1] > WAVERS or (often and self._loose)

    @property
    def _calm(self) -> bool:
        """Whether the last words have been on a line for long."""
        return self._on_line == LONG_WORDS and sum(self._wavers) < CALM * len(self._wavers)

    def _variances(self, fit: WordFit, white: float) -> tuple[float, float]:
        """Estimate the variance of a word's middle by itself, and that of an error that words share.

        Words whose edges lie alike between samples share an error. So what the fit states counts until words
        have covered most places between samples. Only then may the scatter about a curve reduce the variance
        of a middle, by no more than `LEAST_SHARE` leaves. Scatter beyond that variance may last for words, so
        it counts as shared.

        Args:
            white: variance of the middle by its edges, squared samples.

        Returns: both in squared samples, 0 or more.
        """
        freedom = max(0, self._on_line - 3)
        if not freedom:
            return white, fit.unseen**2
        words = np.ascontiguousarray(self._words[:, -self._on_line :])
        covered = freedom * max(0.0, 1.0 - 2.0 * widest_gap(words[1], fit.gap) / fit.gap)
        excess = curve_excess(words, self._scale)
        share = (freedom if excess > 0.0 else covered) / (PRIOR_WORDS + freedom)
        own = max(white + min(0.0, share * excess), LEAST_SHARE * white)
        return own, PRIOR_WORDS / (PRIOR_WORDS + covered) * fit.unseen**2 + max(0.0, share * excess)

    def _find_line(self) -> CellLine | None:
        """Length of a cell by the line through the last words, if they lie on one."""
        count = min(self._words.shape[1], LINE_WORDS)
        if self._early_line is not None and count < LINE_WORDS:
            return self._early_line
        if count < 3:
            return None
        line = line_fit(np.ascontiguousarray(self._words[:, -count:]))
        slope, spread = line.slope, line.square
        self._astray = math.sqrt(max(0.0, spread)) / slope * WORD_CELLS
        expected = max(self._scale * line.shown + line.unseen, 1e-6)
        self._loose = count > 3 and spread > LOOSE * expected
        curved = count < FEW_WORDS or line.ratio > CURVED or self._astray > BENDING
        if spread > 9.0 * expected + SPREAD and curved:  # the speed changes
            return None
        return cell_line(line, count, float(self._words[0, -1]), expected)

    def _by_two(
        self, before: tuple[int, WordFit] | None, number: int, fit: WordFit, side: float
    ) -> tuple[float, float]:
        """Start and variance of a word by itself and, if there is one, the word before it."""
        scale = self._noise(fit)
        if not self.reverse and before is not None and before[0] == number - 1:
            other = before[1]
            lever = WORD_CELLS / 8.0
            place = 0.5 * (other.middle + fit.middle) + lever * (other.cell - fit.cell)
            return place, scale * (place_variance(other, 0.5, lever) + place_variance(fit, 0.5, -lever))
        return moved_grid(fit.grid, side).middle, scale * place_variance(fit, 1.0, side)


def place_variance(fit: WordFit, middle: float, cell: float) -> float:
    """Propagate the covariance of a fit, by white noise, to a place that is linear in its grid.

    The quadratic form is completed to two squares. Their coefficients are the variance of the middle and the
    variance of the cell given the middle, so the result cannot be negative.

    Args:
        middle, cell: derivatives of the place by the middle and by the length of a cell.

    Returns: squared samples.
    """
    own, both, other = (float(fit.covariance[index]) for index in ((0, 0), (0, 1), (1, 1)))
    if not own > 0.0:
        return cell**2 * max(0.0, other)
    return own * (middle + both / own * cell) ** 2 + max(0.0, other - both**2 / own) * cell**2


def std_of(variance: float) -> float:
    """Take the root of the variance of a place, squared samples; `LEAST_STD` is the least result."""
    return math.sqrt(variance + LEAST_STD**2)
