"""Information of the rays of a person about the clocks and line delays of the cameras (kernel)."""

from __future__ import annotations

import numpy as np

from panoptic_ros.continuous.curves import MOST, WIDTH, whiten
from panoptic_ros.geometry.splines import SPAN, basis_at
from panoptic_ros.kernels import njit
from panoptic_ros.solving.bands import forward

TERMS = 3  # unknowns of a camera: offset, drift, line delay
# s between segments, four times the memory of the noise. Hann windows of twice that length overlap, because
# at sharp borders, scores are those of the prior's energy there, which the next segment takes back
SEGMENT_S = 1.0
OVERLAP = 4.0 / 3.0  # variance of a sum over the mean sum of squares of such windows (Welch 1967)


@njit(cache=True, error_model="numpy", nogil=True)
def clock_sums(fit, rays, grid, misses, cameras, factors, count):
    """Return the normal equations of the U = TERMS * C unknowns of C cameras and their coupling to curves.

    Unknown p of camera c has the index p * C + c. Four arrays result. They are the information (U, U), its
    part from noise of velocities, the scores (S, U) of S segments, and the coupling (J, 3K, U) to control
    points. A segment is a window of time. The sum of the scores is the right-hand side. A segment contains
    all joints, because real detectors move the joints of a person together.

    The scores contain the derivative of the curves' own evidence, -1/2 log |H|. Without it, noise
    in the velocities would bias the clocks.

    Args:
        fit: `CurveFit` at the present clocks.
        misses: (N, 2) m, residuals of the rays.
        cameras: (N,) indices.
        factors: (N, TERMS) derivatives of the time of a ray with respect to the unknowns of its camera.
        count: number of cameras C.
    """
    size = TERMS * count
    information = np.zeros((size, size))
    parts = int(grid.number * grid.step / SEGMENT_S) + 2
    scores = np.zeros((parts, size))
    blur, spread = np.zeros((size, size)), np.empty((TERMS, TERMS))
    basis, slope, bend = np.empty(SPAN), np.empty(SPAN), np.empty(SPAN)
    members, shares = np.empty(MOST + 1, np.int64), np.empty(MOST + 1)
    work = np.empty((MOST, MOST + 1))
    row, miss = np.empty((2, WIDTH)), np.empty(2)
    slopes = np.empty((TERMS, 2, WIDTH))  # derivatives of `row` with respect to the unknowns
    change, bend_of = np.empty((2, TERMS)), np.empty(TERMS)
    coupling = np.zeros((len(rays.starts) - 1, 3 * grid.number, size))
    for j in range(len(rays.starts) - 1):
        cross = coupling[j]
        for i in range(rays.starts[j], rays.starts[j + 1]):
            number, variance = whiten(rays, i, members, shares, work)
            oldest = rays.times[members[number - 1]]
            low = basis_at((oldest - grid.origin) / grid.step, grid.number, basis, slope, bend)
            row[:], miss[:], slopes[:] = 0.0, 0.0, 0.0
            top = low + SPAN
            for m in range(number):
                n = members[m]
                k = basis_at((rays.times[n] - grid.origin) / grid.step, grid.number, basis, slope, bend)
                top = max(top, k + SPAN)
                scale = shares[m] / rays.sigmas[n]
                for e in range(2):
                    miss[e] += scale * misses[n, e]
                    for p in range(SPAN):
                        for a in range(3):
                            at, value = 3 * (k - low + p) + a, scale * rays.rows[n, e, a]
                            row[e, at] += basis[p] * value
                            for q in range(TERMS):
                                slopes[q, e, at] += slope[p] / grid.step * value * factors[n, q]
            w = 1.0 / variance
            width = 3 * (top - low)
            sensitivity(fit.points[j], fit.inverses[j], low, width, row, slopes, change, bend_of, spread)
            c = cameras[i]
            place = min(max((rays.times[i] - grid.origin) / SEGMENT_S, 0.0), parts - 1.001)
            later = np.sin(0.5 * np.pi * (place - int(place))) ** 2
            for p in range(TERMS):
                score = w * bend_of[p]
                for q in range(TERMS):
                    blur[p * count + c, q * count + c] += w * spread[p, q]
                for e in range(2):
                    value = w * change[e, p]
                    score += value * miss[e]
                    for q in range(TERMS):
                        information[p * count + c, q * count + c] += value * change[e, q]
                    for a in range(width):
                        cross[3 * low + a, p * count + c] += value * row[e, a]
                scores[int(place), p * count + c] -= (1.0 - later) * score
                scores[int(place) + 1, p * count + c] -= later * score
    return information, blur, scores, coupling


@njit(cache=True, error_model="numpy", nogil=True)
def sensitivity(points, inverse, low, width, row, slopes, change, bend, spread):
    """Write the change of a residual per unknown (2, TERMS), and its covariances.

    They are those with the residual (TERMS,), and among the unknowns (TERMS, TERMS).

    Args:
        points, inverse: of the curve.
        low, width: first control point of `row`, and the number of its coordinates.
        row, slopes: (2, WIDTH) and (TERMS, 2, WIDTH).
    """
    change[:], bend[:], spread[:] = 0.0, 0.0, 0.0
    covered = np.empty(TERMS)
    for e in range(2):
        for a in range(width):
            value = points[low + a // 3, a % 3]
            for p in range(TERMS):
                change[e, p] += slopes[p, e, a] * value
            covered[:], own = 0.0, 0.0
            for b in range(width):
                entry = inverse[3 * low + max(a, b), abs(a - b)]
                own += entry * row[e, b]
                for p in range(TERMS):
                    covered[p] += entry * slopes[p, e, b]
            for p in range(TERMS):
                bend[p] += slopes[p, e, a] * own
                for q in range(TERMS):
                    spread[p, q] += slopes[p, e, a] * covered[q]


@njit(cache=True, error_model="numpy", nogil=True)
def eliminate(information, coupling, factors):
    """Eliminate curves that were fitted joint by joint from the information, in place (Schur complement).

    Args:
        coupling: (J, 3K, U), overwritten.
        factors: see `CurveFit`.
    """
    for j in range(len(factors)):
        forward(factors[j], coupling[j])
        information -= coupling[j].T @ coupling[j]
