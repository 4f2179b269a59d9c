"""The loops of fitting a word's edges to samples, compiled."""
from __future__ import annotations

from functools import lru_cache

import numpy as np
from numba import njit

Array = np.ndarray
_jit = njit(cache=True, error_model="numpy", nogil=True)


@_jit
def wave_columns(
    low: int, values: Array, grid: Array, places: Array, sigma: float, table: Array, terms: int
) -> Array:
    """A word's wave, that times time, its derivatives by middle, cell and bend, the samples, (N, terms + 1).

    Args:
        low: index of the first sample.
        values: (N,) samples.
        places: edges in cells from the middle; the wave rises at the first.
        sigma: samples, of the Gaussian edges.
        table: error function at 0, 1/100, ... standard deviations, up to 6.
        terms: 5, or 4 without the bend.
    """
    count = len(values)
    columns = np.zeros((count, terms + 1))
    middle, cell, bend = grid
    sign, edge, edges = 1.0, 0, len(places)
    here = middle + cell * (places[0] + bend * places[0] ** 2)
    following = middle + cell * (places[1] + bend * places[1] ** 2)
    scale = np.sqrt(2.0 / np.pi) / sigma
    for i in range(count):
        at = low + i
        while edge + 1 < edges and at > 0.5 * (here + following):
            edge += 1
            sign = -sign
            here = following
            if edge + 1 < edges:
                u = places[edge + 1]
                following = middle + cell * (u + bend * u * u)
        distance = (at - here) / sigma
        size = abs(distance)
        if size < 5.9:
            index = int(100.0 * size)
            part = 100.0 * size - index
            value = table[index] * (1.0 - part) + table[index + 1] * part
            wave = sign * value if distance >= 0.0 else -sign * value
            slope = -sign * scale * np.exp(-0.5 * distance * distance)
            u = places[edge]
            columns[i, 2], columns[i, 3] = slope, slope * (u + bend * u * u)
            if terms == 5:
                columns[i, 4] = slope * cell * u * u
        else:
            wave = sign if distance >= 0.0 else -sign
        columns[i, 0] = wave
        columns[i, 1] = wave * (2.0 * i / (count - 1.0) - 1.0)
        columns[i, terms] = values[i]
    return columns


@_jit
def fit_step(columns: Array, baseline: Array) -> tuple[Array, Array, float, Array]:
    """Least squares of the last column by the others with a free baseline.

    Args:
        columns: see `wave_columns`.
        baseline: (T, N) orthonormal.

    Returns: the solution, the inverse of the normal matrix, the squared error, the baseline's weights.
    """
    slow = baseline @ columns
    gram = columns.T @ columns - slow.T @ slow
    terms = len(gram) - 1
    normal, right = gram[:terms, :terms].copy(), gram[:terms, terms].copy()
    trace = np.trace(normal)
    for k in range(terms):
        normal[k, k] += 1e-12 * trace
    inverse = np.linalg.inv(normal)
    solution = inverse @ right
    weights = slow[:, terms].copy()
    for k in range(terms):
        weights -= slow[:, k] * solution[k]
    return solution, inverse, max(gram[terms, terms] - (right * solution).sum(), 0.0), weights


@_jit
def left_over(columns: Array, solution: Array, baseline: Array, weights: Array) -> Array:
    """What the fit does not explain (N,)."""
    error = columns[:, len(solution)].copy()
    for k in range(len(weights)):
        for i in range(len(error)):
            error[i] -= baseline[k, i] * weights[k]
    for i in range(len(error)):
        for k in range(len(solution)):
            error[i] -= columns[i, k] * solution[k]
    return error


@_jit
def score_scatter(columns: Array, error: Array, terms: int) -> Array:
    """Sum over the edges of the outer products of their scores, (terms - 2, terms - 2).

    Args:
        columns: see `wave_columns`; those from the third on are zero away from edges.
        error: (N,) what the fit leaves.
    """
    first, moves = 2, terms - 2
    scatter, score = np.zeros((moves, moves)), np.zeros(moves)
    for i in range(len(error)):
        turning = i > 0 and columns[i, first] == 0.0 and columns[i - 1, first] != 0.0
        between = i > 0 and columns[i, first] * columns[i - 1, first] < 0.0
        if turning or between or i == len(error) - 1:
            for j in range(moves):
                for k in range(moves):
                    scatter[j, k] += score[j] * score[k]
            score[:] = 0.0
        for j in range(moves):
            score[j] += columns[i, first + j] * error[i]
    return scatter


@_jit
def line_fit(numbers: Array, middles: Array, variances: Array) -> tuple[float, float, float, float, float]:
    """The line through words' middles.

    Returns: slope, its norm, squared error per degree of freedom, mean variance, and how alike the errors
    of neighbours are: above 0 if the words lie on a curve.
    """
    x = numbers - numbers.mean()
    y = middles - middles.mean()
    norm = (x * x).sum()
    slope = (x * y).sum() / norm
    error = y - slope * x
    square = (error * error).sum()
    alike = (error[1:] * error[:-1]).sum() / square if square > 0.0 else 0.0
    return slope, norm, square / (len(x) - 2), variances.mean(), alike


@lru_cache(maxsize=1)
def compile_fit() -> None:
    """Compile all of this for the types that it is called with, or take it from numba's cache."""
    values, baseline = np.sin(np.arange(400.0)), np.ones((1, 400)) / 20.0
    columns = wave_columns(
        0, values, np.array([200.0, 20.0, 0.0]), np.arange(-4.0, 5.0), 1.0, np.ones(602), 4
    )
    solution, _, _, weights = fit_step(columns, baseline)
    error = left_over(columns, solution, baseline, weights)
    score_scatter(columns, error, 4)
    line_fit(np.arange(3.0), np.arange(3.0), np.ones(3))
