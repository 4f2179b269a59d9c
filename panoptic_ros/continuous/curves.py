"""Fit a curve to the rays of every joint of a person (kernels).

A curve is a uniform B-spline (`geometry.splines`). Its prior is an acceleration that decorrelates (Singer
1970): jerk + acceleration / DECAY_S is white noise. So the squared third differences of the control points,
with a part of the second ones, have a weight per knot, the stiffness. Ray i at time t_i is the pair of rows
A_i X(t_i) = b_i. Each joint is one banded system of three coordinates per control point.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.geometry.splines import SPAN, weights_at
from panoptic_ros.kernels import inlined, njit
from panoptic_ros.solving.bands import backward, factor, forward, inverse_in_band

Array = np.ndarray
ORDER = 3  # order of the derivative that is white noise in the prior: jerk
# knots after its first control point that a whitened ray reaches: SPAN, and LASTING_S in knots
REACH = 8
WIDTH = 3 * REACH  # band width for three coordinates
# s, time constant of the acceleration. Whole recordings are equal within 1 % from 0.1 s to infinity; the
# newest instant of an online curve has 5 % less error than with white jerk
DECAY_S = 0.2
LASTING_S = 0.1  # s, time over which rays of a camera are whitened
LEAST_PAIRS = 100.0  # effective number of pairs of rays from which persistence is estimated
MOST = 8  # maximum number of previous rays that a ray is whitened with
# share of the stiffness that is added to the diagonal, so that the system of a joint without rays is regular
RIDGE = 1e-9


class WeightedRays(NamedTuple):
    """WeightedRays of N observations of one person, ordered by joint.

    Args:
        starts: (J + 1,) index of the first ray of each joint.
        times: (N,) s.
        rows, rights: (N, 2, 3) and (N, 2). The ray is rows @ X = rights, in m at the depth of the joint.
        sigmas: (N,) m, standard deviation of the ray's noise at the depth of the joint.
        growths: (N,) factor on the variance of the ray's noise, >= 1. It persists as the noise does: two rays
            have the lesser factor in common.
        previous: (N,) index of the previous ray of the same joint and camera, -1 = none near enough.
        lasting: share of the variance that persists over time.
        memory: (s) time constant with which the persistent part decays.
    """

    starts: Array
    times: Array
    rows: Array
    rights: Array
    sigmas: Array
    growths: Array
    previous: Array
    lasting: float
    memory: float


class KnotGrid(NamedTuple):
    """Knots that all curves of a person share.

    Args:
        origin: (s) time of the first knot.
        step: (s) time between knots.
        number: number of control points K.
    """

    origin: float
    step: float
    number: int


class CurveFit(NamedTuple):
    """Curves of J joints.

    Args:
        points: (J, K, 3) m, control points.
        factors: (J, 3K, WIDTH) bands of the Cholesky factors.
        inverses: (J, 3K, WIDTH) m^2, bands of the covariances of the control points.
        differences: (J, K - ORDER) m^2, squared third differences of the control points.
        spreads: (J, K - ORDER) m^2, traces of their covariances.
    """

    points: Array
    factors: Array
    inverses: Array
    differences: Array
    spreads: Array


class AtRays(NamedTuple):
    """Values of the curves at the rays.

    Args:
        positions: (N, 3) m.
        variances: (N,) m^2, of the curve along the two rows, their sum.
    """

    positions: Array
    variances: Array


@njit(cache=True, error_model="numpy", nogil=True)
def fit_curves(rays, grid, stiffness):
    """Fit the curves of all joints.

    Args:
        rays: `WeightedRays`.
        grid: `KnotGrid`.
        stiffness: (J, K - ORDER) 1/m^2, weights of the squared third differences.
    """
    joints, count = len(rays.starts) - 1, grid.number
    points = np.zeros((joints, count, 3))
    factors, rights = normal_equations(rays, grid, stiffness)
    inverses = np.zeros((joints, 3 * count, WIDTH))
    differences = np.zeros((joints, count - ORDER))
    spreads = np.zeros((joints, count - ORDER))
    for j in range(joints):
        band, z = factors[j], rights[j]
        if not factor(band):
            continue
        column = z.reshape(3 * count, 1)
        forward(band, column)
        backward(band, z)
        inverses[j] = inverse_in_band(band)
        points[j] = z.reshape(count, 3)
        third_differences(z, inverses[j], differences[j], spreads[j], grid.step)
    return CurveFit(points, factors, inverses, differences, spreads)


@njit(cache=True, error_model="numpy", nogil=True)
def normal_equations(rays, grid, stiffness):
    """Return the normal matrices (J, 3K, WIDTH), as bands, and right-hand sides (J, 3K) of all joints."""
    joints = len(rays.starts) - 1
    bands, rights = np.zeros((joints, 3 * grid.number, WIDTH)), np.zeros((joints, 3 * grid.number))
    for j in range(joints):
        add_stiffness(bands[j], stiffness[j], grid.step)
        add_rays(bands[j], rights[j], rays, rays.starts[j], rays.starts[j + 1], grid)
    return bands, rights


@njit(cache=True, error_model="numpy", nogil=True)
def jerk_weights(step):
    """Return the weights of four control points in the jerk, with the part of the acceleration."""
    part = 0.5 * step / DECAY_S
    return (-1.0 + part, 3.0 - part, -3.0 - part, 1.0 + part)


@njit(cache=True, error_model="numpy", nogil=True)
def add_stiffness(band, stiffness, step):
    """Add the weights of the third differences of the control points, and the ridge."""
    scale = jerk_weights(step)
    mean = 0.0
    for k in range(len(stiffness)):
        mean += stiffness[k] / len(stiffness)
    for i in range(len(band)):
        band[i, 0] += RIDGE * mean
    for k in range(len(stiffness)):
        for p in range(4):
            for q in range(p + 1):
                value = stiffness[k] * scale[p] * scale[q]
                for a in range(3):
                    band[3 * (k + p) + a, 3 * (p - q)] += value


@njit(cache=True, error_model="numpy", nogil=True)
def add_rays(band, z, rays, first, last, grid):
    """Add the normal equations of the rays first..last (exclusive), each whitened by previous rays."""
    basis = np.empty(SPAN)
    members, shares = np.empty(MOST + 1, np.int64), np.empty(MOST + 1)
    work = np.empty((MOST, MOST + 1))
    row, right = np.empty((2, WIDTH)), np.empty(2)
    for i in range(first, last):
        count, variance = whiten(rays, i, members, shares, work)
        oldest = rays.times[members[count - 1]]
        low = weights_at((oldest - grid.origin) / grid.step, grid.number, basis)
        row[:], right[:] = 0.0, 0.0
        top = low + SPAN
        for m in range(count):
            n = members[m]
            k = weights_at((rays.times[n] - grid.origin) / grid.step, grid.number, basis)
            top = max(top, k + SPAN)
            scale = shares[m] / rays.sigmas[n]
            for e in range(2):
                right[e] += scale * rays.rights[n, e]
                for p in range(SPAN):
                    for a in range(3):
                        row[e, 3 * (k - low + p) + a] += scale * basis[p] * rays.rows[n, e, a]
        w = 1.0 / variance
        for p in range(top - low):
            for a in range(3):
                x, y = w * row[0, 3 * p + a], w * row[1, 3 * p + a]
                at = 3 * (low + p) + a
                z[at] += x * right[0] + y * right[1]
                for q in range(p):
                    for b in range(3):
                        band[at, 3 * (p - q) + a - b] += x * row[0, 3 * q + b] + y * row[1, 3 * q + b]
                for b in range(a + 1):
                    band[at, a - b] += x * row[0, 3 * p + b] + y * row[1, 3 * p + b]


@inlined
def whiten(rays, i, members, shares, work):
    """Write a ray minus its expectation given the previous rays of its camera, as a weighted sum of rays.

    The noise is white noise plus a persistent part with exponential correlation. The conditional
    distribution given the nearest previous rays replaces that given all (Vecchia 1988). Outliers of detectors
    persist, too. As independent errors, the outliers of a camera would outweigh its persistent noise.

    Args:
        members, shares: (MOST + 1,) written: rays, the ray itself first and the oldest last, and weights.
        work: (MOST, MOST + 1) overwritten.

    Returns: the number of rays in the sum, and its variance in units of the noise variance.
    """
    members[0], shares[0] = i, 1.0
    count = 1
    own = rays.growths[i]
    if rays.lasting <= 0.0:
        return count, own
    n = rays.previous[i]
    while n >= 0 and count <= MOST and rays.times[i] - rays.times[n] <= LASTING_S:
        members[count] = n
        count += 1
        n = rays.previous[n]
    size = count - 1
    for p in range(size):
        a = members[p + 1]
        shares[p + 1] = np.exp((rays.times[a] - rays.times[i]) / rays.memory)  # reused for the result below
        for q in range(p):
            common = rays.lasting * min(rays.growths[a], rays.growths[members[q + 1]])
            work[p, q] = work[q, p] = common * shares[p + 1] / shares[q + 1]
        work[p, p] = rays.growths[a]
        work[p, size] = rays.lasting * min(own, rays.growths[a]) * shares[p + 1]
    variance = own
    for p in range(size):  # Gauss elimination of a small positive definite system
        for q in range(p + 1, size):
            scale = work[q, p] / work[p, p]
            for r in range(p, size + 1):
                work[q, r] -= scale * work[p, r]
        variance -= work[p, size] * work[p, size] / work[p, p]
    for p in range(size - 1, -1, -1):
        value = work[p, size]
        for r in range(p + 1, size):
            value += work[p, r] * shares[r + 1]
        shares[p + 1] = -value / work[p, p]
    return count, variance


@njit(cache=True, error_model="numpy", nogil=True)
def third_differences(z, inverse, squares, spreads, step):
    """Write the squared third differences of the control points and the traces of their covariances."""
    scale = jerk_weights(step)
    for k in range(len(squares)):
        square, spread = 0.0, 0.0
        for a in range(3):
            value = 0.0
            for p in range(4):
                value += scale[p] * z[3 * (k + p) + a]
                for q in range(p + 1):
                    entry = scale[p] * scale[q] * inverse[3 * (k + p) + a, 3 * (p - q)]
                    spread += entry if p == q else 2.0 * entry
            square += value * value
        squares[k], spreads[k] = square, spread


@njit(cache=True, error_model="numpy", nogil=True)
def all_third_differences(points, inverses, step):
    """Return `CurveFit.differences` and `CurveFit.spreads` of control points and their covariances."""
    joints, count, _ = points.shape
    squares, spreads = np.empty((joints, count - ORDER)), np.empty((joints, count - ORDER))
    for j in range(joints):
        third_differences(points[j].reshape(3 * count), inverses[j], squares[j], spreads[j], step)
    return squares, spreads


@njit(cache=True, error_model="numpy", nogil=True)
def at_rays(fit, rays, grid):
    """Return the values of the curves at the rays, `AtRays`."""
    total = len(rays.times)
    positions, variances = np.zeros((total, 3)), np.zeros(total)
    basis, spread = np.empty(SPAN), np.empty((3, 3))
    for j in range(len(rays.starts) - 1):
        points, inverse = fit.points[j], fit.inverses[j]
        for i in range(rays.starts[j], rays.starts[j + 1]):
            k = weights_at((rays.times[i] - grid.origin) / grid.step, grid.number, basis)
            for p in range(SPAN):
                for a in range(3):
                    positions[i, a] += basis[p] * points[k + p, a]
            covariance_at(inverse, k, basis, spread)
            variances[i] = along(rays, i, i, spread)
    return AtRays(positions, variances)


@njit(cache=True, error_model="numpy", nogil=True)
def covariance_at(inverse, k, weights, out):
    """Write the covariance (3, 3) of a linear function of control points.

    Args:
        k, weights: index of the first control point, and weights (SPAN,).
    """
    out[:] = 0.0
    for p in range(SPAN):
        for q in range(p):
            scale, lag = weights[p] * weights[q], 3 * (p - q)
            for a in range(3):
                for b in range(3):
                    value = scale * inverse[3 * (k + p) + a, lag + a - b]
                    out[a, b] += value
                    out[b, a] += value
        for a in range(3):
            row = inverse[3 * (k + p) + a]
            out[a, a] += weights[p] ** 2 * row[0]
            for b in range(a):
                value = weights[p] ** 2 * row[a - b]
                out[a, b] += value
                out[b, a] += value


@njit(cache=True, error_model="numpy", nogil=True)
def cross_covariance(inverse, k, left, m, right, out):
    """Write the covariance (3, 3) of two linear functions of control points.

    Args:
        k, left: index of the first control point of the first function, and weights (SPAN,).
        m, right: those of the second function, m <= k < m + REACH - SPAN + 1.
    """
    out[:] = 0.0
    for p in range(SPAN):
        for q in range(SPAN):
            scale, lag = left[p] * right[q], 3 * (k + p - m - q)
            for a in range(3):
                for b in range(3):
                    if lag > 0 or (lag == 0 and a >= b):
                        out[a, b] += scale * inverse[3 * (k + p) + a, lag + a - b]
                    else:
                        out[a, b] += scale * inverse[3 * (m + q) + b, b - a - lag]


@njit(cache=True, error_model="numpy", nogil=True)
def covariances_at(inverses, grid, times):
    """Return the covariances (J, T, 3, 3) m^2 of all joints at times (T,) s."""
    joints = len(inverses)
    out = np.empty((joints, len(times), 3, 3))
    basis = np.empty(SPAN)
    for i in range(len(times)):
        k = weights_at((times[i] - grid.origin) / grid.step, grid.number, basis)
        for j in range(joints):
            covariance_at(inverses[j], k, basis, out[j, i])
    return out


@njit(cache=True, error_model="numpy", nogil=True)
def persistence(fit, rays, grid, misses, variances):
    """Return the share of the noise variance that persists over time, 0..1.

    The covariance of two residuals is that of their noise minus that of the curve. So the moments of the
    noise are those of the residuals plus those of the curve. Rays whose variance has more than doubled are
    left out.

    Args:
        misses: (N, 2) m, residuals.
        variances: see `AtRays`.
    """
    basis, other = np.empty(SPAN), np.empty(SPAN)
    spread = np.empty((3, 3))
    total, number, moment, square = 0.0, 0, 0.0, 0.0
    for j in range(len(rays.starts) - 1):
        inverse = fit.inverses[j]
        for i in range(rays.starts[j], rays.starts[j + 1]):
            if rays.growths[i] > 2.0:
                continue
            total += (misses[i, 0] ** 2 + misses[i, 1] ** 2 + variances[i]) / rays.sigmas[i] ** 2
            number += 1
            n = rays.previous[i]
            k = -1
            while n >= 0 and rays.times[i] - rays.times[n] <= LASTING_S:
                if rays.growths[n] <= 2.0:
                    if k < 0:
                        k = weights_at((rays.times[i] - grid.origin) / grid.step, grid.number, basis)
                    m = weights_at((rays.times[n] - grid.origin) / grid.step, grid.number, other)
                    cross_covariance(inverse, k, basis, m, other, spread)
                    value = misses[i, 0] * misses[n, 0] + misses[i, 1] * misses[n, 1]
                    value += along(rays, i, n, spread)
                    weight = np.exp(-(rays.times[i] - rays.times[n]) / rays.memory)
                    moment += weight * value / (rays.sigmas[i] * rays.sigmas[n])
                    square += weight * weight
                n = rays.previous[n]
    if square < LEAST_PAIRS:
        return 0.0
    return min(max(moment / square / (total / number), 0.0), 0.9)


@inlined
def along(rays, i, n, spread):
    """Return the trace (m^2) of the covariance of the curve along the rows of rays i and n."""
    value = 0.0
    for e in range(2):
        for a in range(3):
            for b in range(3):
                value += rays.rows[i, e, a] * spread[a, b] * rays.rows[n, e, b]
    return value
