"""When exactly a word began: least squares of a polynomial through its edges.

If the bits are known, so are the edges. The integral of the signal over a little to both sides of an edge is
zero if the edge is in the middle, and says how far off it is if not. At constant speed the places of edges
are a line. Where the speed swings within words, they are a polynomial of higher degree. The deviation of the
start follows from the scatter of the edges about it, or from slow bends beyond it if these are more. A delay
that all edges share (echoes, droop, a lopsided filter) does not show there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.timecode.signal.half_cells import Grid, integral
from panoptic_ros.timecode.word.layout import WORD_CELLS
from panoptic_ros.timecode.word.tracking import BETWEEN

Array = np.ndarray
_jit = njit(cache=True, error_model="numpy", nogil=True)
EVEN, SWINGING, ALL = 2, 6, 10  # polynomials: of a constant speed, of one that swings, of channels as well
SLOW = 4  # polynomials beyond those of a fit, whose power tells of errors that neighbouring edges share
REACHES = (0.25, 0.12, 0.12, 0.12)  # cells to both sides of an edge, one step of the fit for each
CLICKS = (1, 2)  # steps before which edges of clicks are left out; the last one only converges
OUTLIER = 4.0  # robust deviations, beyond which an edge is that of a click
LOST = 0.05  # cells by which the last step may still move an edge
SUDDEN = 0.85  # of an edge, that lies between two samples: clipping hides where
LEAST_VARIANCE = 0.01**2  # samples squared: what linear interpolation between samples leaves
POWERS = np.polynomial.legendre.legvander(BETWEEN / BETWEEN[-1], ALL - 1).T.copy()  # (ALL, 161) of the ticks


class EdgeFit(NamedTuple):
    """The edges of a word by a polynomial.

    Args:
        settled: whether the rest holds.
        ticks: (161,) samples, where half cells begin and end.
        grid: the line through the ticks.
        scatter: variance of an edge about the polynomial, squared samples.
        variance: (2,) of the first and the last tick, squared samples.
        waver: variance ratio (F statistic) of what edges swing about a line, and of faster scatter.
        swing: mean square of that swing, squared samples.
    """

    settled: bool
    ticks: Array
    grid: Grid
    scatter: float
    variance: Array
    waver: float
    swing: float


@_jit
def fit_edges(sums: Array, guess: Array, signs: Array, level: float, terms: int) -> EdgeFit:
    """Fit the places of a word's edges.

    Args:
        sums: running sum of the conditioned signal.
        guess: (161,) of its half cells, where they begin and end, good to a quarter of a cell.
        signs: (160,) of the half cells, in the order of the stream.
        level: of the signal.
        terms: of the polynomial.
    """
    after = np.append(signs, -signs[-1])  # sign of the half cell after each tick
    edges = np.flatnonzero(np.append(-signs[0], signs) != after)
    rows = np.ascontiguousarray(POWERS[:, edges])
    ticks, weights = guess, np.ones(len(edges))
    cell = (guess[-1] - guess[0]) / WORD_CELLS
    line = 0.5 * (guess[0] + guess[-1]) + cell * BETWEEN
    error, squares, inverse = np.zeros(0), np.zeros(0), np.zeros((0, 0))
    moved, total, sudden = np.inf, 0.0, False
    for step in range(len(REACHES)):
        reach = REACHES[step] * cell
        away, sudden = _away(sums, ticks[edges], after[edges], reach, level)
        away += ticks[edges] - line[edges]
        if step in CLICKS:
            most = OUTLIER * 1.4826 * np.median(np.abs(error)) + 1e-3 * reach
            weights = (np.abs(error) < most).astype(np.float64)
        weighted = rows * weights
        normal, right = weighted @ rows.T, weighted @ away
        inverse = np.ascontiguousarray(np.linalg.inv(np.ascontiguousarray(normal[:terms, :terms])))
        shape = inverse @ right[:terms]
        error = away - shape @ rows[:terms]
        fitted = line + shape @ POWERS[:terms]
        moved, ticks = np.abs(fitted - ticks).max(), fitted
        squares = np.linalg.solve(np.linalg.cholesky(normal), right) ** 2
        total = (weights * away * away).sum()
    kept = weights.sum()
    scatter = max((total - squares[:terms].sum()) / max(1.0, kept - terms), 0.0)
    fast = (total - squares[:SWINGING].sum()) / max(1.0, kept - SWINGING)
    fast = max(fast, squares[SWINGING:].sum() / (ALL - SWINGING), 1e-12)
    swing = squares[EVEN:SWINGING].sum()
    slow = squares[terms : terms + SLOW].sum() / SLOW
    variance = np.full(2, LEAST_VARIANCE + (1.0 / 12.0 if sudden else 0.0))
    for i in range(2):
        at = np.ascontiguousarray(POWERS[:terms, -i])
        variance[i] += max(scatter, slow) * (inverse @ at * at).sum()
    grid = Grid(ticks[WORD_CELLS], (ticks[-1] - ticks[0]) / WORD_CELLS)
    settled = moved < LOST * cell and np.isfinite(ticks).all()
    return EdgeFit(settled, ticks, grid, scatter, variance, swing / SLOW / fast, swing / kept)


@_jit
def _away(sums: Array, places: Array, after: Array, reach: float, level: float) -> tuple[Array, bool]:
    """How far edges (N,) are beyond some places, samples, and whether they lie between two samples each.

    Args:
        after: (N,) sign of the signal after each edge.
        reach: samples to both sides; edges are no farther off. level: of the signal.
    """
    away, slope, jump = np.empty(len(places)), 0.0, 0.0
    for i, place in enumerate(places):
        away[i] = after[i] * (integral(sums, place + reach) - integral(sums, place - reach))
        for side in (-1.0, 1.0):
            slope += side * after[i] * _sample(sums, place + side * reach)
            jump += side * after[i] * _sample(sums, np.ceil(place) - 0.5 + 0.5 * side)
    slope = max(slope / len(places), level)
    return np.minimum(np.maximum(-away / slope, -reach), reach), jump > SUDDEN * slope * len(places)


@_jit
def _sample(sums: Array, place: float) -> float:
    """The signal at a place, mean over one sample."""
    value: float = integral(sums, place + 0.5) - integral(sums, place - 0.5)
    return value
