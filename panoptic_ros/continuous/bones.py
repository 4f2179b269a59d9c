"""Curves of all joints of a person at once, with lengths between joints of a rigid part as measurements.

The unknowns are ordered by knot, joint and axis, so the system stays banded. Lengths are measured on a grid
of instants, linearised at the present curves (Gauss-Newton).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.continuous.block_bands import covariances_in_band, factor_blocks, solve_blocks
from panoptic_ros.continuous.curves import WIDTH, CurveFit, covariances_at, normal_equations
from panoptic_ros.continuous.problem import CurveProblem
from panoptic_ros.domain import SkeletonModel
from panoptic_ros.geometry.medians import row_medians
from panoptic_ros.geometry.splines import SPAN, spline, weights_at
from panoptic_ros.kernels import njit

Array = np.ndarray
INTERVAL_S = 0.02  # s between two measurements of a length
LEAST_ERROR = 5e-4  # m, least standard deviation of a learnt length
# m, spread of a distance beyond its noise: up to the first a pair is rigid, from the second on it is free
RIGID, FREE = 6e-3, 5e-2
# s, correlation time of a spread. Errors of real 2D poses last as long, so identities count noise that way
CORRELATION_S = 0.2
# s, that of simulated noise: errors of learnt lengths are 1.1 to 1.2 of their standard deviations
NOISE_S = 0.1
LEAST_CERTAIN = 0.1  # m, greatest standard deviation of a distance from which a length is learnt
SHORTEST = 1e-3  # m, length below which a pair has no direction


class PairDistances(NamedTuple):
    """Distances of P pairs of joints at T instants.

    Args:
        lengths: (P, T) m, corrected for the noise of both joints.
        variances: (P, T) m^2 along the pair.
    """

    lengths: Array
    variances: Array


class LearntLengths(NamedTuple):
    """Learnt lengths of P pairs of joints.

    Args:
        lengths: (P,) m.
        weights: (P,) 1/m^2 of one measurement, 0 = the pair is free.
        variances: (P,) m^2 of the lengths, as those of a person: spread, and noise of the mean.
    """

    lengths: Array
    weights: Array
    variances: Array


def rigid_pairs(skeleton: SkeletonModel) -> Array:
    """Return the pairs (P, 2) of joints that may keep their distance: bones, and pairs in head and torso.

    The head consists of the neck, the head joint and the joints behind it. The torso consists of the root,
    the neck, and the joints next to both.
    """
    parents = skeleton.parents
    children = [[k for k, parent in enumerate(parents) if parent == j] for j in range(len(skeleton))]
    neck = parents[skeleton.head] if parents[skeleton.head] >= 0 else skeleton.root
    head, waiting = {neck, skeleton.head}, [skeleton.head]
    while waiting:
        behind = children[waiting.pop()]
        head.update(behind)
        waiting += behind
    torso = {skeleton.root, neck, *children[skeleton.root], *children[neck]} - (head - {neck})
    pairs = {(min(bone), max(bone)) for bone in skeleton.bones}
    for part in (head, torso):
        pairs |= {(a, b) for a in part for b in part if a < b}
    return np.array(sorted(pairs), np.int64).reshape(-1, 2)


def pair_distances(
    problem: CurveProblem, fit: CurveFit, pairs: Array, since: float = -np.inf
) -> PairDistances:
    """Return the distances of pairs (P, 2) of joints on curves that were fitted joint by joint.

    Args:
        since: (s) earliest instant.
    """
    times = instants(problem)
    times = times[times >= since]
    gaps = _gaps(problem, fit.points, pairs, times)
    lengths = np.maximum(np.linalg.norm(gaps, axis=-1), SHORTEST)
    along = gaps / lengths[..., None]
    covariances = covariances_at(fit.inverses, problem.grid, times)
    total = covariances[pairs[:, 0]] + covariances[pairs[:, 1]]
    variances = np.einsum("pti,ptij,ptj->pt", along, total, along)
    across = np.trace(total, axis1=-2, axis2=-1) - variances
    return PairDistances(lengths - 0.5 * across / lengths, variances)


def learn_lengths(distances: PairDistances) -> LearntLengths:
    """Return the lengths of pairs as medians of the certain half of their distances.

    A pair whose distances spread more than their noise is not rigid. Its weight then states that spread, else
    the error of the length. A pair with a joint that no view shows is free. Averaging reduces the noise, not
    the spread.
    """
    usual = np.median(distances.variances, axis=1, keepdims=True)
    shown = (usual[:, 0] < LEAST_CERTAIN**2) & (distances.lengths > 0.0).any(axis=1)
    certain = (distances.variances < 2.0 * usual) | ~shown[:, None]
    lengths = np.where(certain, distances.lengths, np.nan)
    middle = row_medians(lengths)
    spread = (1.4826 * row_medians(np.abs(lengths - middle[:, None]))) ** 2
    noise = row_medians(np.where(certain, distances.variances, np.nan))
    spread -= noise
    noise /= np.maximum(certain.sum(axis=1) * INTERVAL_S / (2.0 * NOISE_S), 1.0)
    error = np.where(spread > RIGID**2, spread, np.maximum(noise, LEAST_ERROR**2))
    weights = INTERVAL_S / (2.0 * CORRELATION_S) / error
    return LearntLengths(
        np.where(shown, middle, 0.0),
        np.where((spread > FREE**2) | ~shown, 0.0, weights),
        np.maximum(spread, 0.0) + noise * CORRELATION_S / NOISE_S,
    )


def length_weights(problem: CurveProblem, fit: CurveFit, pairs: Array, learnt: LearntLengths) -> Array:
    """Return the weights (P, T) 1/m^2 of the lengths at `instants`.

    The direction of a pair with a joint that is hidden for long is unknown. So the noise of its length
    contains the variance of the second-order term, as in a second-order extended Kalman filter. Else hidden
    joints pull the others. The variance is tr((H P)^2) / 2 with the Hessian H = (I - u u^T) / length.

    Args:
        fit: curves that were fitted joint by joint.
    """
    times, grid = instants(problem), problem.grid
    knots = np.clip((times - grid.origin) / grid.step, 0, problem.inside.shape[1] - 1).astype(np.int64)
    hidden = ~problem.inside[:, knots]
    weights = np.repeat(learnt.weights[:, None], len(times), axis=1)
    p, t = np.nonzero((hidden[pairs[:, 0]] | hidden[pairs[:, 1]]) & (weights > 0.0))
    first, second = pairs[p].T
    some, t = np.unique(t, return_inverse=True)
    covariances = covariances_at(fit.inverses, grid, times[some])
    spread = covariances[first, t] + covariances[second, t]
    gaps = _gaps(problem, fit.points, pairs, times[some])[p, t]
    along = gaps / np.maximum(np.linalg.norm(gaps, axis=1, keepdims=True), SHORTEST)
    across = np.eye(3) - along[:, :, None] * along[:, None]
    bends = 0.5 * ((across @ spread @ across) ** 2).sum(axis=(1, 2)) / learnt.lengths[p] ** 2
    own = learnt.weights[p]
    weights[p, some[t]] = own / (1.0 + own * bends * 2.0 * CORRELATION_S / INTERVAL_S)
    return weights


def step_with_lengths(
    problem: CurveProblem,
    points: Array,
    pairs: Array,
    learnt: LearntLengths,
    weights: Array,
    stiffness: Array,
    blocks: Array,
) -> Array:
    """Return the control points (J, K, 3) m after one Gauss-Newton step of all curves.

    Whitened rays couple control points that are `SPAN` and more apart a little. The matrix of the step has a
    bound of that part on its diagonal, which keeps the band narrow. The residuals are exact.

    Args:
        points: (J, K, 3) m, control points at which the lengths are linearised.
        weights: (P, T) 1/m^2 of the lengths at `instants`.
        stiffness: (J, K - ORDER) 1/m^2.
        blocks: (K, SPAN, 3J, 3J), written: the factor of the matrix as in `factor_blocks`.
    """
    joints, grid = len(points), problem.grid
    times = instants(problem)
    bands, rights = normal_equations(problem.rays, grid, stiffness)
    right = couple(bands, rights, points, blocks)
    gaps = _gaps(problem, points, pairs, times)
    add_lengths(blocks, right, grid, times, pairs, gaps, learnt.lengths, weights)
    factor_blocks(blocks)
    step = solve_blocks(blocks, right).reshape(grid.number, joints, 3)
    found: Array = points + step.transpose(1, 0, 2)
    return found


def instants(problem: CurveProblem) -> Array:
    """Return the instants (T,) s, at least one, at which lengths are measured."""
    first, last = float(problem.times.min()), float(problem.times.max())
    return first + INTERVAL_S * np.arange(int((last - first) / INTERVAL_S) + 1)


def _gaps(problem: CurveProblem, points: Array, pairs: Array, times: Array) -> Array:
    """Return the gaps (P, T, 3) m of the pairs."""
    grid = problem.grid
    places = spline(grid.origin, grid.step, points.transpose(1, 0, 2))(times).transpose(1, 0, 2)
    gaps: Array = places[pairs[:, 0]] - places[pairs[:, 1]]
    return gaps


@njit(cache=True, error_model="numpy", nogil=True)
def couple(bands, rights, points, blocks):
    """Write the systems of all joints as one, by knot, joint and axis; return rights - A points (K, 3J).

    Entries between control points `SPAN` and more apart move to the diagonal, as absolute values. The matrix
    grows by that, so it stays positive definite.

    Args:
        bands, rights: see `normal_equations`.
        points: (J, K, 3) m.
        blocks: (K, SPAN, 3J, 3J), see `factor_blocks`.
    """
    joints, size, width = bands.shape
    blocks[:] = 0.0
    right = np.empty((size // 3, 3 * joints))
    for j in range(joints):
        place = points[j].reshape(size)
        residual = rights[j].copy()
        for i in range(size):
            residual[i] -= bands[j, i, 0] * place[i]
            blocks[i // 3, 0, 3 * j + i % 3, 3 * j + i % 3] += bands[j, i, 0]
            for k in range(1, min(width, i + 1)):
                value, m = bands[j, i, k], i - k
                if value == 0.0:
                    continue
                residual[i] -= value * place[m]
                residual[m] -= value * place[i]
                apart = i // 3 - m // 3
                if apart < SPAN:
                    blocks[m // 3, apart, 3 * j + i % 3, 3 * j + m % 3] = value
                else:
                    for n in (i, m):
                        blocks[n // 3, 0, 3 * j + n % 3, 3 * j + n % 3] += abs(value)
        right[:, 3 * j : 3 * j + 3] = residual.reshape(size // 3, 3)
    return right


@njit(cache=True, error_model="numpy", nogil=True)
def add_lengths(blocks, right, grid, times, pairs, gaps, lengths, weights):
    """Add measurements of the lengths of P pairs at T instants.

    Args:
        blocks, right: see `couple`.
        gaps: (P, T, 3) m, of the pairs at the present curves.
        lengths: (P,) m.
        weights: (P, T) 1/m^2 of the measurements.
    """
    basis = np.empty(SPAN)
    along, both = np.empty(3), np.empty((3, 3))
    for t in range(len(times)):
        k = weights_at((times[t] - grid.origin) / grid.step, grid.number, basis)
        for p in range(len(pairs)):
            w = weights[p, t]
            if w <= 0.0:
                continue
            gap = gaps[p, t]
            length = max(np.sqrt(gap[0] ** 2 + gap[1] ** 2 + gap[2] ** 2), SHORTEST)
            along[:] = gap / length
            miss = w * (lengths[p] - length)
            first, second = 3 * pairs[p, 0], 3 * pairs[p, 1]
            for a in range(3):
                for b in range(3):
                    both[a, b] = w * along[a] * along[b]
            for m in range(SPAN):
                for a in range(3):
                    right[k + m, first + a] += basis[m] * miss * along[a]
                    right[k + m, second + a] -= basis[m] * miss * along[a]
                for n in range(m, SPAN):
                    block, scale = blocks[k + m, n - m], basis[m] * basis[n]
                    for a in range(3):
                        for b in range(3):
                            value = scale * both[a, b]
                            block[first + a, first + b] += value
                            block[second + a, second + b] += value
                            block[first + a, second + b] -= value
                            block[second + a, first + b] -= value


def block_inverses(factor: Array) -> Array:
    """Return the covariances of each joint's control points in the band, (J, 3K, WIDTH) m^2.

    Args:
        factor: (K, SPAN, 3J, 3J), see `factor_blocks`.
    """
    count, _, block, _ = factor.shape
    inverses = np.zeros((block // 3, 3 * count, WIDTH))
    for k, here, cross, _ in covariances_in_band(factor):
        collect(here, cross, k, inverses)
    return inverses


@njit(cache=True, error_model="numpy", nogil=True)
def collect(here, cross, k, inverses):
    """Write the covariances of each joint's control point k with itself and with later ones.

    Args:
        here, cross: see `covariances_in_band`.
    """
    joints, size, _ = inverses.shape
    for j in range(joints):
        for p in range(min(len(cross) + 1, size // 3 - k)):
            values = here if p == 0 else cross[(k + p) % len(cross)]
            for a in range(3):
                for b in range(3):
                    lag = 3 * p + a - b
                    if lag >= 0:
                        inverses[j, 3 * (k + p) + a, lag] = values[3 * j + a, 3 * j + b]
