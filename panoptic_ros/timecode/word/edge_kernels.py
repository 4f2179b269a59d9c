"""The loops of fitting every edge of a word by itself, where the speed changes within the word."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.timecode.signal.baseline import Baseline
from panoptic_ros.timecode.signal.clicks import clicked
from panoptic_ros.timecode.signal.grid import Grid
from panoptic_ros.timecode.signal.wave import Edges, Samples, train_rows
from panoptic_ros.timecode.word.fit_kernels import FILLS, FitLimits, edge_errors, fit_step, left_over, misfit
from panoptic_ros.timecode.word.smoothing import Motion, Smoothed, smooth

Array = np.ndarray
_jit = njit(cache=True, error_model="numpy", nogil=True)
NEAR, LEAST = 0.2, 5e-5  # standard deviations and samples, by which the last step may still move edges


class EdgeFit(NamedTuple):
    """The fit of a word's edges.

    Args:
        settled: whether the rest holds.
        measured, noise: (N,) places of edges by the samples alone, and their variances by white noise.
        smoothed: the places by the tape's motion as well.
        level: signed, that before the first edge is -level.
        clean: (N,) samples without clicks.
        clicked: whether there were any.
        misfit: squared samples, see `misfit`.
    """

    settled: bool
    measured: Array
    noise: Array
    smoothed: Smoothed
    level: float
    clean: Array
    clicked: bool
    misfit: float


@_jit
def fit_edges(
    samples: Samples,
    cells: Array,
    guess: Array,
    shape: Array,
    baseline: Baseline,
    limits: FitLimits,
    motion: tuple[Motion, float, int],
) -> EdgeFit:
    """Fit the places and the level of a word's edges by Gauss-Newton steps; clicks are left out.

    Args:
        cells: (N,) of the edges, and those before that belong to another word.
        guess: (N,) samples, of the edges.
        shape: see `train_rows`.
        motion: before the word, its bandwidth, and how many edges belong to the word before.
    """
    before, bandwidth, others = motion
    values = samples.values
    places, clean, fills = guess.copy(), values, 0
    cell = (places[-1] - places[others]) / (cells[-1] - cells[others])
    grid = Grid(0.5 * (places[others] + places[-1]), cell)
    rows = np.zeros((1, 1))
    error, settled, level = values, False, 0.0
    freedom = max(1, len(values) - len(baseline.basis) - 2)
    measured, noise = places[others:].copy(), np.ones(len(places) - others)
    smoothed = smooth(cells[others:], measured, noise, before, bandwidth)
    for turn in range(limits.steps + FILLS):
        edges = Edges(grid, (places - grid.middle) / grid.cell)
        rows = train_rows(Samples(samples.first, clean), edges, shape)
        few = np.empty((3, len(values)))
        few[0], few[1], few[2] = rows[0], rows[1], rows[4]
        solution, _, square, weights = fit_step(few, baseline)
        level = solution[0]
        if abs(level) < 1e-9 or not np.isfinite(solution).all():
            break
        error = left_over(few, solution, baseline, weights)
        sigma = np.sqrt(square / freedom)
        away, noise = edge_errors(samples.first, error, edges, shape, level, sigma)
        most = 0.1 * grid.cell
        measured = (places + np.minimum(np.maximum(away, -most), most))[others:]
        noise = noise[others:]
        smoothed = smooth(cells[others:], measured, noise, before, bandwidth)
        moved = np.abs(smoothed.places - places[others:]).max()
        places[others:] = smoothed.places
        finished = moved <= NEAR * np.sqrt(smoothed.variances.min()) + LEAST
        if not finished and turn + 1 < limits.steps + fills:
            continue
        settled = moved <= limits.lost * grid.cell
        if not finished or fills == FILLS:
            break
        raw_error = error + values - clean
        clicks = clicked(raw_error, rows[2], abs(level), limits.outlier, limits.gross, limits.shaken)
        if not (fills or clicks.any()):
            break
        clean = values.copy()
        for i in range(len(values)):
            if clicks[i]:
                clean[i] = values[i] - raw_error[i]
        fills += 1
    unlike = misfit(samples.first, rows, error, Edges(grid, (places - grid.middle) / grid.cell)) / level**2
    return EdgeFit(settled, measured, noise, smoothed, level, clean, fills > 0, unlike)


@_jit
def line_through(cells: Array, places: Array, noise: Array) -> tuple[tuple[float, float], Array]:
    """The line through edges (N,): middle and cell, and their covariance (2, 2)."""
    normal, right = np.zeros((2, 2)), np.zeros(2)
    start = places[0]
    for k in range(len(cells)):
        u, weight = cells[k], 1.0 / noise[k]
        normal[0, 0] += weight
        normal[0, 1] += weight * u
        normal[1, 1] += weight * u * u
        right[0] += weight * (places[k] - start)
        right[1] += weight * u * (places[k] - start)
    normal[1, 0] = normal[0, 1]
    covariance = np.linalg.inv(normal)
    solution = covariance @ right
    return (start + solution[0], solution[1]), covariance


@_jit
def waver(cells: Array, away: Array, noise: Array, terms: int) -> tuple[float, float]:
    """Whether edges (N,) swing about a line: variance ratio (F statistic), and squared samples of the swing.

    A tape swings slowly. What channels do to edges depends on the bits, so it swings fast as well: the
    polynomials of the swing are compared with the scatter about them, and with as many of higher order.

    Args:
        away: samples, by which edges are off their places. noise: variances.
        terms: polynomials beyond the line's two.
    """
    count, all_terms = len(cells), 2 + 2 * terms
    rows = np.empty((all_terms, count))
    weights = 1.0 / np.sqrt(noise)
    x = (2.0 * cells - cells[0] - cells[-1]) / (cells[-1] - cells[0])
    for k in range(count):
        rows[0, k], rows[1, k] = weights[k], weights[k] * x[k]
        for j in range(2, all_terms):  # Legendre's
            rows[j, k] = ((2.0 * j - 1.0) * x[k] * rows[j - 1, k] - (j - 1.0) * rows[j - 2, k]) / j
    error = away * weights
    root = np.linalg.cholesky(rows @ rows.T)
    right = rows @ error
    left = (error * error).sum()
    squares = np.empty(all_terms)  # explained by each polynomial beyond those before it
    for j in range(all_terms):
        value = right[j]
        for i in range(j):
            value -= root[j, i] * right[i]
        right[j] = value / root[j, j]
        squares[j] = right[j] ** 2
        left -= squares[j]
    scatter = max(left / (count - all_terms), squares[2 + terms :].sum() / terms)
    swing = squares[2 : 2 + terms].sum()
    return swing / terms / scatter, swing / (weights * weights).sum()
