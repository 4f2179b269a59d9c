"""The loops of fitting a word's wave to samples.
"""
from __future__ import annotations

import numpy as np
from numba import njit

from panoptic_ros.timecode.signal.baseline import gram_without
from panoptic_ros.timecode.signal.clicks import clicked
from panoptic_ros.timecode.signal.wave import train_rows

Array = np.ndarray
_jit = njit(cache=True, error_model="numpy", nogil=True)
_sum = njit(cache=True, error_model="numpy", nogil=True, fastmath={"reassoc", "contract"})
BESIDE = 3  # samples to both sides of an edge, which are most of it
SURELY = 2.0  # times what noise would leave
FILLS = 5  # times that clicks are replaced by what the fit says: it then says a little less of them
BATCH = 8  # edges that are judged together: hum moves neighbours against each other


@_jit
def fit_train(
    low: int, values: Array, grid: Array, places: Array, shape: Array, basis: Array, step: int,
    limits: Array, bending: bool,
) -> tuple[bool, Array, float, Array, Array, Array, bool, float]:  # fmt: skip
    """Fit grid and level of a word with known edges by Gauss and Newton; samples far off are left out.

    Args:
        grid: (3,) a guess.
        basis, step: see `baseline`.
        limits: see `timing`.

    Returns: whether it settled, grid, level, white and observed covariance (3, 3), samples without clicks,
    whether there were any, and `misfit`.
    """
    terms = 5 if bending else 4
    steps, settled, lost, outlier, gross, sigma, shaken = limits
    half = 0.5 * (places[-1] - places[0])
    grid, clean, fills, moved, level = grid.copy(), values, 0, np.inf, 0.0
    nothing = np.zeros((3, 3))
    rows = np.zeros((1, 1))
    error = values
    freedom = max(1, len(values) - len(basis) - terms)
    for turn in range(int(steps) + FILLS):
        rows = train_rows(low, clean, grid, places, shape, terms)
        solution, inverse, square, weights = fit_step(rows, basis, step)
        level = solution[0]
        if abs(level) < 1e-9 or not np.isfinite(solution).all():
            return False, grid, level, nothing, nothing, clean, False, 0.0
        change = solution[2:] / level
        grid[0] += min(max(change[0], -0.2 * grid[1]), 0.2 * grid[1])
        grid[1] += min(max(change[1], -0.002 * grid[1]), 0.002 * grid[1])
        if bending:
            grid[2] += min(max(change[2], -2e-4), 2e-4)
        noise = np.sqrt(square / freedom)
        moved = max(abs(change[0]), half * abs(change[1]))
        finished = moved <= settled * sigma + 0.1 * noise / abs(level) * np.sqrt(inverse[2, 2])
        if not finished and turn + 1 < int(steps) + fills:
            continue
        error = left_over(rows, solution, basis, step, weights)
        if not finished or fills == FILLS:
            break
        error += values - clean
        clicks = clicked(error, rows[2], abs(level), outlier, gross, shaken)
        if not (fills or clicks.any()):
            break
        clean = np.where(clicks, values - error, values)
        fills += 1
    white, seen = nothing.copy(), nothing.copy()
    moves = terms - 2
    corner = np.ascontiguousarray(inverse[2:, 2:])
    white[:moves, :moves] = corner * (square / freedom / level**2)
    scatter = score_scatter(low, rows, error, grid, places, moves)
    seen[:moves, :moves] = corner @ scatter @ corner / level**2
    unlike = misfit(low, rows, error, grid, places) / level**2
    return moved <= lost * grid[1], grid, level, white, seen, clean, fills > 0, unlike


@_jit
def fit_step(rows: Array, basis: Array, step: int) -> tuple[Array, Array, float, Array]:
    """Least squares of the last row by the others with a free baseline.

    Args:
        rows: see `train_rows`.
        basis, step: see `baseline`.

    Returns: the solution, the inverse of the normal matrix, the squared error, the baseline's weights.
    """
    gram, slow = gram_without(rows, basis, step)
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
def left_over(rows: Array, solution: Array, basis: Array, step: int, weights: Array) -> Array:
    """What the fit does not explain (N,)."""
    error = rows[len(solution)].copy()
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
def score_scatter(low: int, rows: Array, error: Array, grid: Array, places: Array, moves: int) -> Array:
    """Sum over batches of edges of the outer products of their scores, (moves, moves).

    Args:
        rows: see `train_rows`; those from the third on are slopes.
        error: (N,) what the fit leaves.
    """
    scatter, score = np.zeros((moves, moves)), np.zeros(moves)
    begin, count = 0, len(error)
    for k in range(BATCH, len(places) + BATCH, BATCH):
        end = count
        if k + BATCH // 2 < len(places):
            u = 0.5 * (places[k - 1] + places[k])
            end = min(max(int(grid[0] + grid[1] * (u + grid[2] * u * u)) - low, begin), count)
        if end <= begin:
            continue
        for j in range(moves):
            total = 0.0
            for i in range(begin, end):
                total += rows[2 + j, i] * error[i]
            score[j] = total
        for j in range(moves):
            for i in range(moves):
                scatter[j, i] += score[j] * score[i]
        begin = end
    return scatter


@_sum
def misfit(low: int, rows: Array, error: Array, grid: Array, places: Array) -> float:
    """How far, in squared samples, what all edges leave alike may have moved them.

    A fit leaves nothing along the slope. What it leaves across it, sample by sample beside the edges and
    surely not by noise, tells how much of a wrong shape there may be along it.
    """
    mean, inside = np.zeros(2 * BESIDE), 0
    sign = 1.0
    for u in places:
        first = int(np.ceil(grid[0] + grid[1] * (u + grid[2] * u * u) - low)) - BESIDE
        if first >= 0 and first + 2 * BESIDE <= len(error):
            for j in range(2 * BESIDE):
                mean[j] += sign * error[first + j]
            inside += 1
        sign = -sign
    power, steep = 0.0, 0.0
    for i in range(len(error)):
        power += error[i] * error[i]
        steep += rows[2, i] * rows[2, i]
    noise = SURELY * 2 * BESIDE * power / len(error) * inside
    excess = max(0.0, (mean * mean).sum() - noise) / max(1, inside)
    return excess / (2 * BESIDE - 1) / steep


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
