"""Lines and curves through the middles of words."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.timecode.word.layout import WORD_CELLS

Array = np.ndarray
_jit = njit(cache=True, error_model="numpy", nogil=True)
FAR = 20.0  # times the median of squares: three standard deviations


class LineFit(NamedTuple):
    """A line through the middles of words.

    Args:
        slope: samples per word; norm: sum of squared numbers about their mean.
        square: squared error per degree of freedom. ratio: variance ratio (F statistic) of a cubic's two
            terms, 0 for fewer than 6 words.
        shown, unseen: mean variances, by white noise and unseen.
        bend: samples per word squared, of the parabola beside the line. bend_norm: what its variance is
            that of a word over. centre: the number where line and parabola are parallel.
        lean, bow: what the last word adds to the slope and to the bend, per sample.
    """

    slope: float
    norm: float
    square: float
    ratio: float
    shown: float
    unseen: float
    bend: float
    bend_norm: float
    centre: float
    lean: float
    bow: float


class CellLine(NamedTuple):
    """The length of a cell, where it changes evenly from word to word or not at all.

    Args:
        centre: number of a word. cell: samples, there. variance: of that.
        turn: samples by which it changes per word. turn_variance: of that.
        own: by how much its length at the last word changes with that word's middle, samples per sample.
        scatter: variance of a word's middle about the curve, squared samples, that `variance` and
            `turn_variance` follow from at least.
    """

    centre: float
    cell: float
    variance: float
    turn: float
    turn_variance: float
    own: float
    scatter: float

    def steady(self) -> CellLine:
        """The same for words beside those that it comes from: a change that may not last is doubt."""
        return self._replace(turn=0.0, turn_variance=self.turn**2 + self.turn_variance, own=0.0)

    def at(self, number: float) -> float:
        """Return the length of a cell at a word, samples."""
        return self.cell + self.turn * (number - self.centre)

    def variance_beside(self, number: float, side: float, word_variance: float) -> float:
        """Propagate the joint covariance of a word's middle and of the length of a cell to a place beside it.

        The middle of the last word is one of the points of the line, so both are correlated. The place is
        linear in the errors of the words. Its variance is that of the last word's own share, plus that of the
        other words. Each is a square times a variance, so the sum cannot be negative.

        Args:
            number: of the last word. side: cells from its middle to the place.
            word_variance: of that middle, squared samples, 0 or more.

        Returns: squared samples.
        """
        since = number - self.centre
        length = self.variance + self.turn_variance * since**2
        # Exact least squares keeps this at 0 or more (Cauchy-Schwarz); the limit is for rounding.
        others = max(0.0, length - self.own**2 * self.scatter)
        return (1.0 + side * self.own) ** 2 * word_variance + side**2 * others


def cell_line(line: LineFit, count: int, last: float, expected: float) -> CellLine:
    """The length of a cell by a line through words, or by a parabola as far as they show one.

    The bend of words on a line is noise, of variance `expected` over its norm. How large real bends are is
    not known: the variance that makes the one found most likely is its square less that of noise. So the
    bend is shrunk to its posterior mean by empirical Bayes (Efron and Morris 1973), to 0 where noise
    explains it.

    Args:
        count: of the words. last: number of the last one. expected: variance of one about the curve.
    """
    noise = expected / line.bend_norm
    share = max(0.0, 1.0 - noise / max(line.bend**2, 1e-18))
    square = (count - 2) * line.square - share * line.bend**2 * line.bend_norm
    spread = max(square / (count - 2 - share), expected)
    return CellLine(
        line.centre,
        line.slope / WORD_CELLS,
        spread / line.norm / WORD_CELLS**2,
        2.0 * share * line.bend / WORD_CELLS,
        4.0 * share * noise / WORD_CELLS**2,
        (line.lean + 2.0 * share * line.bow * (last - line.centre)) / WORD_CELLS,
        expected,
    )


@_jit
def line_fit(words: Array) -> LineFit:
    """The line through words' middles.

    Args:
        words: (4, N) numbers, middles, variances by white noise, and unseen.
    """
    count = words.shape[1]
    shown, unseen = words[2].mean(), words[3].mean()
    x = words[0] - words[0].mean()
    y = words[1] - words[1].mean()
    norm = (x * x).sum()
    slope = (x * y).sum() / norm
    error = y - slope * x
    square = (error * error).sum()
    lean = (x**3).sum() / norm
    parabola = x * x - lean * x - norm / count
    bend_norm = max((parabola * parabola).sum(), 1e-12)
    bend = (parabola * error).sum() / bend_norm
    ratio = 0.0
    if count >= 6 and square > 0.0:
        powers = _powers(x / np.abs(x).max(), 4)
        right = (powers * error).sum(axis=1)
        left = max(square - (right * np.linalg.solve(_products(powers), right)).sum(), 1e-9 * square)
        ratio = 0.5 * (square - left) / (left / (count - 4))
    return LineFit(
        slope,
        norm,
        square / (count - 2),
        ratio,
        shown,
        unseen,
        bend,
        bend_norm,
        words[0].mean() + 0.5 * lean,
        x[-1] / norm,
        parabola[-1] / bend_norm,
    )


@_jit
def curve_excess(words: Array, scale: float) -> float:
    """Mean of squared errors about a parabola through words' middles, beyond their variances.

    Args:
        words: see `line_fit`; few far off count less.
        scale: of the variances.
    """
    count = words.shape[1]
    x = (words[0] - words[0].mean()) / max(1.0, words[0, -1] - words[0, 0])
    y = words[1] - words[1].mean()
    powers = _powers(x, 3)
    weights = np.linalg.solve(_products(powers), (powers * y).sum(axis=1))
    squares = (y - weights[0] * powers[0] - weights[1] * powers[1] - weights[2] * powers[2]) ** 2
    most, total = FAR * np.median(squares), 0.0
    for square in squares:
        total += min(square, most)
    excess: float = total / (count - 3) - scale * words[2].mean()
    return excess


@_jit
def _powers(x: Array, count: int) -> Array:
    """The powers from 0 on of numbers (N,), in rows."""
    powers = np.empty((count, len(x)))
    for k in range(count):
        for i in range(len(x)):
            powers[k, i] = x[i] ** float(k)
    return powers


@_jit
def _products(rows: Array) -> Array:
    """Of the rows of a matrix with each other."""
    out = np.empty((len(rows), len(rows)))
    for i in range(len(rows)):
        for j in range(len(rows)):
            out[i, j] = (rows[i] * rows[j]).sum()
    return out
