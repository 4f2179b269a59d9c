"""Curves of all joints of a person at once, with lengths between joints of a rigid part as measurements.

The unknowns are ordered by knot, joint and axis, so the system stays banded. Lengths are measured on a grid
of instants, linearised at the present curves (Gauss-Newton).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded

from panoptic_ros.continuous.curves import REACH, WIDTH, CurveFit, covariances_at, normal_equations
from panoptic_ros.continuous.problem import CurveProblem
from panoptic_ros.domain import SkeletonModel
from panoptic_ros.geometry.splines import SPAN, basis_at, spline
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
    middle = np.nanmedian(lengths, axis=1)
    spread = (1.4826 * np.nanmedian(np.abs(lengths - middle[:, None]), axis=1)) ** 2
    noise = np.nanmedian(np.where(certain, distances.variances, np.nan), axis=1)
    spread -= noise
    noise /= np.maximum(certain.sum(axis=1) * INTERVAL_S / (2.0 * NOISE_S), 1.0)
    error = np.where(spread > RIGID**2, spread, np.maximum(noise, LEAST_ERROR**2))
    weights = INTERVAL_S / (2.0 * CORRELATION_S) / error
    return LearntLengths(
        np.where(shown, middle, 0.0),
        np.where((spread > FREE**2) | ~shown, 0.0, weights),
        np.maximum(spread, 0.0) + noise * CORRELATION_S / NOISE_S,
    )


def step_with_lengths(
    problem: CurveProblem, points: Array, pairs: Array, learnt: LearntLengths, stiffness: Array
) -> tuple[Array, Array]:
    """Take one Gauss-Newton step of all curves.

    Args:
        points: (J, K, 3) m, control points at which the lengths are linearised.
        stiffness: (J, K - ORDER) 1/m^2.

    Returns: the new control points, and the Cholesky factor as in `couple`.
    """
    joints, grid = len(points), problem.grid
    times = instants(problem)
    reach = REACH if problem.persistent > 0.0 else SPAN
    bands, rights = normal_equations(problem.rays, grid, stiffness)
    columns, right = couple(bands, rights, reach)
    gaps = _gaps(problem, points, pairs, times)
    along = gaps / np.maximum(np.linalg.norm(gaps, axis=-1), SHORTEST)[..., None]
    add_lengths(columns, right, grid, times, pairs, along, learnt)
    lower = cholesky_banded(columns.T, overwrite_ab=True, lower=True, check_finite=False)
    solution = cho_solve_banded((lower, True), right, check_finite=False)
    found = np.ascontiguousarray(solution.reshape(grid.number, joints, 3).transpose(1, 0, 2))
    return found, lower.T


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
def couple(bands, rights, reach):
    """Return the systems of all joints as one, ordered by knot, joint and axis.

    Args:
        bands, rights: see `normal_equations`.
        reach: half bandwidth of a joint's system, in control points.

    Returns: the lower band by columns, columns[i, k] = A[i + k, i], and the right-hand side.
    """
    joints, size, width = bands.shape
    block = 3 * joints
    columns = np.zeros((size * joints, reach * block))
    right = np.zeros(size * joints)
    for j in range(joints):
        for i in range(size):
            row = (i // 3) * block + 3 * j + i % 3
            right[row] = rights[j, i]
            for k in range(min(3 * reach, width, i + 1)):
                column = ((i - k) // 3) * block + 3 * j + (i - k) % 3
                if row - column < reach * block:
                    columns[column, row - column] = bands[j, i, k]
    return columns, right


@njit(cache=True, error_model="numpy", nogil=True)
def add_lengths(columns, right, grid, times, pairs, along, learnt):
    """Add measurements of the lengths of P pairs at T instants.

    Args:
        along: (P, T, 3) directions of the pairs.
        learnt: `LearntLengths`.
    """
    block = len(right) // grid.number
    basis, slope, bend = np.empty(SPAN), np.empty(SPAN), np.empty(SPAN)
    index, value = np.empty(6 * SPAN, np.int64), np.empty(6 * SPAN)
    for t in range(len(times)):
        k = basis_at((times[t] - grid.origin) / grid.step, grid.number, basis, slope, bend)
        for p in range(len(pairs)):
            w = learnt.weights[p]
            if w <= 0.0:
                continue
            n = 0
            for m in range(SPAN):
                for s in range(2):
                    sign = 1.0 if s == 0 else -1.0
                    for a in range(3):
                        index[n] = (k + m) * block + 3 * pairs[p, s] + a
                        value[n] = sign * basis[m] * along[p, t, a]
                        n += 1
            for i in range(n):
                scale = w * value[i]
                right[index[i]] += scale * learnt.lengths[p]
                for j in range(n):
                    if index[j] <= index[i]:
                        columns[index[j], index[i] - index[j]] += scale * value[j]


def block_inverses(columns: Array, joints: int, reach: int) -> Array:
    """Return the covariances of each joint's control points in the band, (J, 3K, WIDTH) m^2.

    Args:
        columns: (n, reach * 3J) Cholesky factor, columns[i, k] = L[i + k, i].
        reach: half bandwidth in blocks.
    """
    block = 3 * joints
    inverses = np.zeros((joints, len(columns) // joints, WIDTH))
    for k, here, cross, _ in block_covariances(columns, block, reach):
        collect(here, cross, k, inverses)
    return inverses


def block_covariances(columns: Array, block: int, reach: int) -> Iterator[tuple[int, Array, Array, Array]]:
    """Yield the covariances in the band, from the last block to the first (Takahashi's recursion).

    Args:
        columns: (n, reach * block) Cholesky factor, columns[i, k] = L[i + k, i].
        reach: half bandwidth in blocks.

    Yields: index of a block, its covariance (block, block), the covariance ((reach - 1) * block, block) of
        later blocks with it, and that of later blocks. They are 0 beyond the last block.
    """
    later = np.zeros(((reach - 1) * block, (reach - 1) * block))
    unpacked = np.zeros((reach * block, block))
    for k in range(len(columns) // block - 1, -1, -1):
        unpack(columns, k * block, unpacked)
        own = np.linalg.inv(unpacked[:block])
        gain = unpacked[block:] @ own
        cross = later @ -gain
        here = own.T @ own - gain.T @ cross
        here = 0.5 * (here + here.T)  # asymmetric errors would grow from block to block
        yield k, here, cross, later
        later[block:, block:] = later[:-block, :-block].copy()
        later[:block, :block] = here
        later[block:, :block] = cross[:-block]
        later[:block, block:] = cross[:-block].T


@njit(cache=True, error_model="numpy", nogil=True)
def unpack(columns, first, out):
    """Write the columns of one block of the factor as a matrix (reach * 3J, 3J)."""
    out[:] = 0.0
    height, block = out.shape
    for c in range(block):
        for r in range(c, height):
            out[r, c] = columns[first + c, r - c]


@njit(cache=True, error_model="numpy", nogil=True)
def collect(here, cross, k, inverses):
    """Write the covariances of each joint's control point k with itself and with later ones."""
    joints, size, _ = inverses.shape
    block = 3 * joints
    count = min(len(cross) // block + 1, size // 3 - k)
    for j in range(joints):
        for p in range(count):
            for a in range(3):
                for b in range(3):
                    lag = 3 * p + a - b
                    if lag >= 0:
                        row = 3 * j + a
                        value = here[row, 3 * j + b] if p == 0 else cross[(p - 1) * block + row, 3 * j + b]
                        inverses[j, 3 * (k + p) + a, lag] = value
