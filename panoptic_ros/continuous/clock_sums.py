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
    blur = np.zeros((size, size))
    basis, slope, bend = np.empty(SPAN), np.empty(SPAN), np.empty(SPAN)
    members, shares = np.empty(MOST + 1, np.int64), np.empty(MOST + 1)
    work = np.empty((MOST, MOST + 1))
    # the row of a ray, and its derivatives with respect to the unknowns; their products with `window`
    rows, images, miss = np.empty((1 + TERMS, 2, WIDTH)), np.empty((1 + TERMS, 2, WIDTH)), np.empty(2)
    flat_rows, flat_images = rows.reshape(1 + TERMS, -1), images.reshape(1 + TERMS, -1)
    # control points from `begin` on, and their covariances
    place_of, window = np.empty(WIDTH), np.empty((WIDTH, WIDTH))
    coupling = np.zeros((len(rays.starts) - 1, 3 * grid.number, size))
    for j in range(len(rays.starts) - 1):
        cross, begin = coupling[j], -1
        for i in range(rays.starts[j], rays.starts[j + 1]):
            number, variance = whiten(rays, i, members, shares, work)
            oldest = rays.times[members[number - 1]]
            low = basis_at((oldest - grid.origin) / grid.step, grid.number, basis, slope, bend)
            if low != begin:
                begin = low
                copy_window(fit.points[j], fit.inverses[j], low, place_of, window)
            rows[:], miss[:] = 0.0, 0.0
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
                            rows[0, e, at] += basis[p] * value
                            for q in range(TERMS):
                                rows[1 + q, e, at] += slope[p] / grid.step * value * factors[n, q]
            w = 1.0 / variance
            width = 3 * (top - low)
            change = np.dot(rows.reshape(-1, WIDTH), place_of).reshape(1 + TERMS, 2)
            np.dot(rows.reshape(-1, WIDTH), window, images.reshape(-1, WIDTH))
            spread = np.dot(flat_rows, flat_images.T)  # covariances of the residual and its derivatives
            c = cameras[i]
            place = min(max((rays.times[i] - grid.origin) / SEGMENT_S, 0.0), parts - 1.001)
            later = np.sin(0.5 * np.pi * (place - int(place))) ** 2
            for p in range(TERMS):
                score = w * spread[1 + p, 0]
                for q in range(TERMS):
                    blur[p * count + c, q * count + c] += w * spread[1 + p, 1 + q]
                for e in range(2):
                    value = w * change[1 + p, e]
                    score += value * miss[e]
                    for q in range(TERMS):
                        information[p * count + c, q * count + c] += value * change[1 + q, e]
                    for a in range(width):
                        cross[3 * low + a, p * count + c] += value * rows[0, e, a]
                scores[int(place), p * count + c] -= (1.0 - later) * score
                scores[int(place) + 1, p * count + c] -= later * score
    return information, blur, scores, coupling


@njit(cache=True, error_model="numpy", nogil=True)
def copy_window(points, inverse, low, place, window):
    """Write control points (WIDTH,) from `low` on and their covariance (WIDTH, WIDTH), 0 beyond the last."""
    place[:], window[:] = 0.0, 0.0
    for a in range(min(WIDTH, len(inverse) - 3 * low)):
        place[a] = points[low + a // 3, a % 3]
        for b in range(a + 1):
            window[a, b] = window[b, a] = inverse[3 * low + a, a - b]


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
