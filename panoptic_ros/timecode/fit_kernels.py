"""The loops of fitting a word's edges to samples, compiled.

A word's wave is a sum of steps, that is of signs and, near each edge, of a table (2, P + 1, 2 R): what a step
has more than its sign, and its slope, at R samples to both sides and P places between two samples. Entry
(p, j) is for a sample that lies j - R + p / P after the edge.
"""
from __future__ import annotations

from functools import lru_cache

import numpy as np
from numba import njit

from panoptic_ros.timecode.click_kernels import clicked

Array = np.ndarray
_jit = njit(cache=True, error_model="numpy", nogil=True)
_sum = njit(cache=True, error_model="numpy", nogil=True, fastmath={"reassoc", "contract"})
BESIDE = 3  # samples to both sides of an edge, which are most of it
SURELY = 2.0  # times what noise would leave
FILLS = 5  # times that clicks are replaced by what the fit says: it then says a little less of them
BATCH = 8  # edges that are judged together: hum moves neighbours against each other


@_jit
def train_rows(low: int, values: Array, grid: Array, places: Array, shape: Array, terms: int) -> Array:
    """A word's wave, that times time, its derivatives by middle, cell and bend, the samples, (terms + 1, N).

    Args:
        low: index of the first sample.
        values: (N,) samples.
        places: edges in cells from the middle; the wave rises at the first.
        shape: (2, P + 1, 2 R) what a step has more than its sign, and its slope.
        terms: 5, or 4 without the bend.
    """
    count = len(values)
    phases, reach = shape.shape[1] - 1, shape.shape[2] // 2
    rows = np.zeros((terms + 1, count))
    middle, cell, bend = grid
    sign, begin = -1.0, 0
    for k in range(len(places)):
        u = places[k]
        stretched = u + bend * u * u
        edge = middle + cell * stretched - low
        after = int(np.ceil(edge))
        end = min(max(after, 0), count)
        for i in range(begin, end):
            rows[0, i] += sign
        begin, sign = end, -sign
        place = (after - edge) * phases
        below = min(int(place), phases - 1)
        part = place - below
        first = after - reach
        for j in range(max(0, -first), min(2 * reach, count - first)):
            i = first + j
            more = shape[0, below, j] * (1.0 - part) + shape[0, below + 1, j] * part
            slope = -sign * (shape[1, below, j] * (1.0 - part) + shape[1, below + 1, j] * part)
            rows[0, i] += sign * more
            rows[2, i] += slope
            rows[3, i] += slope * stretched
            if terms == 5:
                rows[4, i] += slope * cell * u * u
    for i in range(begin, count):
        rows[0, i] += sign
    scale = 2.0 / (count - 1.0)
    for i in range(count):
        rows[1, i] = rows[0, i] * (scale * i - 1.0)
        rows[terms, i] = values[i]
    return rows


@_sum
def hat_sums(rows: Array, step: int) -> Array:
    """Products (I, K) of rows (I, N) with hats on every `step`-th sample, down to 0 on the next ones."""
    count = rows.shape[1]
    sums = np.zeros((len(rows), (count - 1) // step + 2))
    for i in range(len(rows)):
        row, out = rows[i], sums[i]
        for j in range(step):
            after = j / step
            for k in range((count - 1 - j) // step + 1):
                value = row[k * step + j]
                out[k] += (1.0 - after) * value
                out[k + 1] += after * value
    return sums


@_sum
def gram_without(rows: Array, basis: Array, step: int) -> tuple[Array, Array]:
    """Products (I, I) of rows (I, N) without their part in a baseline, and that part (I, T).

    Written out, since these are too small for a library that starts threads.

    Args:
        basis, step: see `baseline`.
    """
    sums = hat_sums(rows, step)
    slow = np.empty((len(rows), len(basis)))
    gram = np.empty((len(rows), len(rows)))
    for i in range(len(rows)):
        for j in range(len(basis)):
            total = 0.0
            for k in range(basis.shape[1]):
                total += sums[i, k] * basis[j, k]
            slow[i, j] = total
    for i in range(len(rows)):
        for j in range(i, len(rows)):
            total = 0.0
            for k in range(rows.shape[1]):
                total += rows[i, k] * rows[j, k]
            for k in range(slow.shape[1]):
                total -= slow[i, k] * slow[j, k]
            gram[i, j] = gram[j, i] = total
    return gram, slow


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


@lru_cache(maxsize=1)
def compile_fit() -> None:
    """Compile all of this for the types that it is called with, or take it from numba's cache."""
    values, grid, places = np.sin(np.arange(400.0)), np.array([200.0, 20.0, 0.0]), np.arange(-4.0, 5.0)
    basis, shape = np.ones((1, 401)) / 20.0, np.ones((2, 3, 4))
    basis.flags.writeable = shape.flags.writeable = False  # as the real ones: other types for numba
    limits = np.array([2.0, 0.1, 0.1, 4.0, 0.2, 1.0, 1.0])
    fit_train(0, values, grid, places, shape, basis, 1, limits, False)
    rows = train_rows(0, values, grid, places, shape, 4)
    gram_without(rows, basis, 1)
    hat_sums(rows, 1)
