"""The loops over the middles of words, compiled: lines and curves through them."""
from __future__ import annotations

from functools import lru_cache

import numpy as np
from numba import njit

Array = np.ndarray
FAR = 20.0  # times the median of squares: three standard deviations
_jit = njit(cache=True, error_model="numpy", nogil=True)


@_jit
def _products(rows: Array) -> Array:
    """Of the rows of a matrix with each other."""
    out = np.empty((len(rows), len(rows)))
    for i in range(len(rows)):
        for j in range(len(rows)):
            out[i, j] = (rows[i] * rows[j]).sum()
    return out


@_jit
def line_fit(words: Array) -> tuple[float, float, float, float, float, float]:
    """The line through words' middles.

    Args:
        words: (4, N) numbers, middles, variances by white noise, and unseen.

    Returns: slope, its norm, squared error per degree of freedom, how much more a cubic explains by each
    of its two terms than it leaves by each degree of freedom (0 for fewer than 6 words), mean variances.
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
        return slope, norm, square / (count - 2), 0.0, shown, unseen
    x /= np.abs(x).max()
    powers = np.empty((4, count))
    for k in range(4):
        powers[k] = x**k
    right = (powers * error).sum(axis=1)
    left = max(square - (right * np.linalg.solve(_products(powers), right)).sum(), 1e-9 * square)
    ratio = 0.5 * (square - left) / (left / (count - 4))
    return slope, norm, square / (count - 2), ratio, shown, unseen


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
    powers = np.empty((3, count))
    for k in range(3):
        powers[k] = x**k
    weights = np.linalg.solve(_products(powers), (powers * y).sum(axis=1))
    squares = (y - weights[0] * powers[0] - weights[1] * powers[1] - weights[2] * powers[2]) ** 2
    squares = np.minimum(squares, FAR * np.median(squares))
    return squares.sum() / (count - 3) - scale * words[2].mean()


@_jit
def jumps(values: Array, level: float) -> float:
    """Share of the changes of sign of samples (N,) that lie between two samples of level plateaus."""
    crossings, sudden = 0, 0
    for i in range(1, len(values) - 2):
        if (values[i] > 0.0) == (values[i + 1] > 0.0):
            continue
        crossings += 1
        if abs(values[i + 1] - values[i]) > 1.6 * level:
            flat = max(abs(values[i] - values[i - 1]), abs(values[i + 2] - values[i + 1]))
            sudden += int(flat < 0.06 * level)
    return sudden / max(1, crossings)


@_jit
def widest_gap(places: Array, period: float) -> float:
    """Within a period, the widest gap between places (N,)."""
    phases = np.sort(places % period)
    widest = phases[0] + period - phases[-1]
    for i in range(1, len(phases)):
        widest = max(widest, phases[i] - phases[i - 1])
    return widest


@lru_cache(maxsize=1)
def compile_lines() -> None:
    """Compile all of this for the types that it is called with, or take it from numba's cache."""
    words = np.arange(36.0).reshape(4, 9)[:, 2:]
    line_fit(words)
    curve_excess(words, 1.0)
    line_fit(words.copy())
    curve_excess(words.copy(), 1.0)
    jumps(np.ones(7), 1.0)
    widest_gap(np.ones(7), 1.0)
