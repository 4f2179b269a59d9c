"""Compute the exact start of a word: a least-squares polynomial fit through its edges.

Known bits determine which half-cell boundaries are edges. The integral of the signal over a short window
around an edge is zero if the edge is at the window centre. Otherwise it is proportional to the distance. At
constant speed the edge positions form a line. If the speed swings within a word, they form a polynomial of
higher degree. The standard deviation of the start follows from the scatter of the edges about the fit. Slow
bends beyond the fit replace that scatter if they are larger. A delay that all edges share (echoes, droop, an
asymmetric filter) is not included.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.timecode.signal.half_cells import CellGrid, integral
from panoptic_ros.timecode.word.layout import WORD_CELLS
from panoptic_ros.timecode.word.tracking import BETWEEN

Array = np.ndarray
_jit = njit(cache=True, error_model="numpy", nogil=True)
# polynomial terms for constant speed, for swinging speed, and for channel effects as well
EVEN, SWINGING, ALL = 2, 6, 10
SLOW = 4  # terms after those of the fit; their power measures the errors that neighbouring edges share
REACHES = (0.25, 0.12, 0.12, 0.12)  # cells on each side of an edge, one value per step of the fit
CLICKS = (1, 2)  # steps that first exclude the edges of clicks; the last step only converges
OUTLIER = 4.0  # robust standard deviations beyond which an edge belongs to a click
LOST = 0.05  # cells; the fit fails if the last step moves an edge by more than this
# share of an edge's height between two adjacent samples above which clipping hides the edge position
SUDDEN = 0.85
LEAST_VARIANCE = 0.01**2  # samples squared, error of the linear interpolation between samples
# (ALL, 161) Legendre polynomials at the ticks of a word
POWERS = np.polynomial.legendre.legvander(BETWEEN / BETWEEN[-1], ALL - 1).T.copy()


class EdgeFit(NamedTuple):
    """Polynomial fit of the edges of a word.

    Args:
        settled: True if the fit has converged; otherwise the other fields are invalid.
        ticks: (161,) boundaries of the half cells, samples.
        grid: line through the first and the last tick, about the middle tick.
        scatter: variance of an edge about the polynomial, samples squared.
        variance: (2,) variance of the first and the last tick, samples squared.
        waver: (F statistic) variance ratio of the slow swing of the edges about a line to their faster
            scatter.
        swing: (samples squared) mean square of the slow swing.
    """

    settled: bool
    ticks: Array
    grid: CellGrid
    scatter: float
    variance: Array
    waver: float
    swing: float


@_jit
def fit_edges(sums: Array, guess: Array, signs: Array, level: float, terms: int) -> EdgeFit:
    """Fit the positions of a word's edges.

    Args:
        sums: running sum of the conditioned signal.
        guess: (161,) initial boundaries of the half cells, accurate to a quarter of a cell.
        signs: (160,) signs of the half cells, in stream order.
        level: mean level of the signal.
        terms: number of polynomial terms.
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
    grid = CellGrid(ticks[WORD_CELLS], (ticks[-1] - ticks[0]) / WORD_CELLS)
    settled = moved < LOST * cell and np.isfinite(ticks).all()
    return EdgeFit(settled, ticks, grid, scatter, variance, swing / SLOW / fast, swing / kept)


@_jit
def _away(sums: Array, places: Array, after: Array, reach: float, level: float) -> tuple[Array, bool]:
    """Return the offsets (N,) of edges from given positions (samples), and whether edges are abrupt.

    Edges are abrupt if each one lies between two adjacent samples.

    Args:
        after: (N,) sign of the signal after each edge.
        reach: samples on each side of a position; offsets are clipped to it.
        level: mean level of the signal.
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
    """Return the signal at a position, averaged over one sample."""
    value: float = integral(sums, place + 0.5) - integral(sums, place - 0.5)
    return value
