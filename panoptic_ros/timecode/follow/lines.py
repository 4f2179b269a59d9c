"""Lines and curves through the middles of words.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.kernels.order import median

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
    """

    slope: float
    norm: float
    square: float
    ratio: float
    shown: float
    unseen: float


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
    if count < 6 or square <= 0.0:
        return LineFit(slope, norm, square / (count - 2), 0.0, shown, unseen)
    x /= np.abs(x).max()
    powers = _powers(x, 4)
    right = (powers * error).sum(axis=1)
    left = max(square - (right * np.linalg.solve(_products(powers), right)).sum(), 1e-9 * square)
    ratio = 0.5 * (square - left) / (left / (count - 4))
    return LineFit(slope, norm, square / (count - 2), ratio, shown, unseen)


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
    most, total = FAR * median(squares.copy()), 0.0
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
