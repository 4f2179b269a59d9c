"""The loops of fitting a word's wave to samples."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.kernels import njit
from panoptic_ros.timecode.signal.baseline import Baseline, gram_without
from panoptic_ros.timecode.signal.clicks import clicked
from panoptic_ros.timecode.signal.grid import Grid
from panoptic_ros.timecode.signal.wave import Edges, Samples, train_rows

Array = np.ndarray
_jit = njit(cache=True, error_model="numpy", nogil=True)
_sum = njit(cache=True, error_model="numpy", nogil=True, fastmath={"reassoc", "contract"})
BESIDE = 3  # samples to both sides of an edge, which are most of it
SURELY = 2.0  # times the power that noise would leave
FILLS = 5  # times that clicks are replaced by the fit, which then depends a little less on them
BATCH = 8  # edges per batch: hum moves neighbours against each other


class FitLimits(NamedTuple):
    """When a fit has settled, and what is left out of it.

    Args:
        steps: of Gauss and Newton, at most.
        settled: standard deviations of an edge; a step that is smaller is the last.
        lost: cells by which the last step may still move edges.
        outlier: standard deviations; samples that err by less are no clicks.
        gross: times the level; samples that err by less are no clicks.
        sigma: samples, standard deviation of an edge.
        shaken: samples by which single edges may be misplaced.
    """

    steps: int
    settled: float
    lost: float
    outlier: float
    gross: float
    sigma: float
    shaken: float


class TrainFit(NamedTuple):
    """The fit of a word's edges.

    Args:
        settled: whether the rest holds.
        grid: as fitted.
        level: signed, that before the first edge is -level.
        white: (2, 2) covariance of the grid, for white noise.
        observed: (2, 2) the same, from what batches of edges say.
        clean: (N,) samples without clicks.
        clicked: whether there were any.
        misfit: squared samples, see `misfit`.
        away, noise: (E,) see `edge_errors`.
    """

    settled: bool
    grid: Grid
    level: float
    white: Array
    observed: Array
    clean: Array
    clicked: bool
    misfit: float
    away: Array
    noise: Array


@_jit
def fit_train(
    samples: Samples, edges: Edges, shape: Array, baseline: Baseline, limits: FitLimits
) -> TrainFit:
    """Fit grid and level of a word with known edges by Gauss-Newton steps; clicks are left out.

    Args:
        edges: their grid is a guess.
        shape: see `train_rows`.
    """
    values, places = samples.values, edges.places
    half = 0.5 * (places[-1] - places[0])
    grid, clean, fills, moved, level = edges.grid, values, 0, np.inf, 0.0
    nothing, nowhere = np.zeros((2, 2)), np.zeros(1)
    rows = np.zeros((1, 1))
    error = values
    freedom = max(1, len(values) - len(baseline.basis) - 4)
    for turn in range(limits.steps + FILLS):
        rows = train_rows(Samples(samples.first, clean), Edges(grid, places), shape)
        solution, inverse, square, weights = fit_step(rows, baseline)
        level = solution[0]
        if abs(level) < 1e-9 or not np.isfinite(solution).all():
            return TrainFit(False, grid, level, nothing, nothing, clean, False, 0.0, nowhere, nowhere)
        change = solution[2:] / level
        grid = _stepped(grid, change)
        noise = np.sqrt(square / freedom)
        moved = max(abs(change[0]), half * abs(change[1]))
        own = noise / abs(level) * np.sqrt(max(inverse[2, 2], 0.0))
        finished = moved <= limits.settled * limits.sigma + 0.1 * own
        if not finished and turn + 1 < limits.steps + fills:
            continue
        error = left_over(rows, solution, baseline, weights)
        if not finished or fills == FILLS:
            break
        error += values - clean
        clicks = clicked(error, rows[2], abs(level), limits.outlier, limits.gross, limits.shaken)
        if not (fills or clicks.any()):
            break
        clean = values.copy()
        for i in range(len(values)):
            if clicks[i]:
                clean[i] = values[i] - error[i]
        fills += 1
    white, observed = nothing.copy(), nothing.copy()
    edges = Edges(grid, places)
    corner = inverse[2:, 2:].copy()
    scatter = score_scatter(samples.first, rows, error, edges)
    spread = corner @ scatter @ corner
    for j in range(2):
        for i in range(2):
            white[j, i] = corner[j, i] * (square / freedom / level**2)
            observed[j, i] = spread[j, i] / level**2
    unlike = misfit(samples.first, rows, error, edges) / level**2
    settled = moved <= limits.lost * grid.cell
    away, alone = edge_errors(samples.first, error, edges, shape, level, np.sqrt(square / freedom))
    return TrainFit(settled, grid, level, white, observed, clean, fills > 0, unlike, away, alone)


@_jit
def _stepped(grid: Grid, change: Array) -> Grid:
    """The grid after a step (2,), which is limited."""
    middle, cell = grid
    middle += min(max(change[0], -0.2 * cell), 0.2 * cell)
    cell += min(max(change[1], -0.002 * cell), 0.002 * cell)
    return Grid(middle, cell)


@_jit
def fit_step(rows: Array, baseline: Baseline) -> tuple[Array, Array, float, Array]:
    """Least squares of the last row by the others, with a free baseline.

    Args:
        rows: see `train_rows`.

    Returns: the solution, the inverse of the normal matrix, the squared error, the baseline's weights.
    """
    gram, slow = gram_without(rows, baseline)
    terms = len(gram) - 1
    normal, right = gram[:terms, :terms].copy(), gram[:terms, terms].copy()
    trace = np.trace(normal)
    for k in range(terms):
        normal[k, k] += 1e-12 * trace
    inverse = np.linalg.inv(normal)
    solution = inverse @ right
    weights = slow[terms].copy()
    for k in range(terms):
        weights -= slow[k] * solution[k]
    return solution, inverse, max(gram[terms, terms] - (right * solution).sum(), 0.0), weights


@_jit
def left_over(rows: Array, solution: Array, baseline: Baseline, weights: Array) -> Array:
    """Residuals (N,) of the fit."""
    basis, step = baseline
    error: Array = rows[len(solution)].copy()
    knots = np.zeros(basis.shape[1])
    for j in range(len(weights)):
        for k in range(len(knots)):
            knots[k] += weights[j] * basis[j, k]
    for j in range(step):
        after = j / step
        for k in range((len(error) - 1 - j) // step + 1):
            error[k * step + j] -= (1.0 - after) * knots[k] + after * knots[k + 1]
    for k in range(len(solution)):
        factor = solution[k]
        for i in range(len(error)):
            error[i] -= rows[k, i] * factor
    return error


@_sum
def score_scatter(first: int, rows: Array, error: Array, edges: Edges) -> Array:
    """Sum over batches of edges of the outer products of their scores, (2, 2).

    Args:
        rows: see `train_rows`; those from the third on are slopes.
        error: (N,) residuals.
    """
    middle, cell = edges.grid
    places = edges.places
    scatter, score = np.zeros((2, 2)), np.zeros(2)
    begin, count = 0, len(error)
    for k in range(BATCH, len(places) + BATCH, BATCH):
        end = count
        if k + BATCH // 2 < len(places):
            u = 0.5 * (places[k - 1] + places[k])
            end = min(max(int(middle + cell * u) - first, begin), count)
        if end <= begin:
            continue
        for j in range(2):
            total = 0.0
            for i in range(begin, end):
                total += rows[2 + j, i] * error[i]
            score[j] = total
        for j in range(2):
            for i in range(2):
                scatter[j, i] += score[j] * score[i]
        begin = end
    return scatter


@_sum
def misfit(first: int, rows: Array, error: Array, edges: Edges) -> float:
    """How far, in squared samples, an error that all edges share may have moved them.

    A fit leaves no residual along the slope. The mean residual across it, sample by sample beside the edges
    and beyond noise, tells how much of a wrong shape there may be along it.
    """
    middle, cell = edges.grid
    mean, inside = np.zeros(2 * BESIDE), 0
    sign = 1.0
    for u in edges.places:
        begin = int(np.ceil(middle + cell * u - first)) - BESIDE
        if begin >= 0 and begin + 2 * BESIDE <= len(error):
            for j in range(2 * BESIDE):
                mean[j] += sign * error[begin + j]
            inside += 1
        sign = -sign
    power, steep = 0.0, 0.0
    for i in range(len(error)):
        power += error[i] * error[i]
        steep += rows[2, i] * rows[2, i]
    noise = SURELY * 2 * BESIDE * power / len(error) * inside
    excess = max(0.0, (mean * mean).sum() - noise) / max(1, inside)
    square: float = excess / (2 * BESIDE - 1) / steep
    return square


@_jit
def edge_errors(
    first: int, error: Array, edges: Edges, shape: Array, level: float, sigma: float
) -> tuple[Array, Array]:
    """How far each edge (N,) is from where it was drawn, and the variance of that by white noise.

    Args:
        error: (M,) residuals of the samples from `first` on.
        shape: see `train_rows`; level: of the wave, signed; sigma: of the noise.
    """
    middle, cell = edges.grid
    places = edges.places
    phases, reach = shape.shape[1] - 1, shape.shape[2] // 2
    away, noise = np.zeros(len(places)), np.zeros(len(places))
    sign = 1.0
    for k in range(len(places)):
        u = places[k]
        edge = middle + cell * u - first
        after = int(np.ceil(edge))
        place = (after - edge) * phases
        below = min(max(int(place), 0), phases - 1)
        part = place - below
        start = after - reach
        score, weight = 0.0, 0.0
        for j in range(max(0, -start), min(2 * reach, len(error) - start)):
            slope = -sign * (shape[1, below, j] * (1.0 - part) + shape[1, below + 1, j] * part)
            score += slope * error[start + j]
            weight += slope * slope
        weight = max(weight, 1e-12)
        away[k] = score / (level * weight)
        noise[k] = sigma * sigma / (level * level * weight)
        sign = -sign
    return away, noise
