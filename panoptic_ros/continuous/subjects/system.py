"""Normal equations of curves of D degrees of freedom (kernels).

The unknowns are ordered by knot, then degree of freedom, so that the system is banded. It is stored as its
lower band by columns, columns[i, k] = A[i + k, i].
"""

from __future__ import annotations

import numpy as np

from panoptic_ros.continuous.curves import MOST, REACH, whiten
from panoptic_ros.geometry.splines import SPAN, weights_at
from panoptic_ros.kernels import njit


@njit(cache=True, error_model="numpy", nogil=True)
def add_rays(columns, right, rays, grid, misses, slopes, moving):
    """Add the rays of one person, each whitened by previous rays of its camera.

    Args:
        columns, right: (n, width) and (n,) of the step that reduces the misses, in place.
        rays: `WeightedRays`.
        grid: `KnotGrid`.
        misses: (N, 2) m.
        slopes: (N, 2, D) derivatives of the misses by the degrees of freedom at the times of the rays.
        moving: (J, D) True where a degree of freedom moves a joint.
    """
    freedoms = slopes.shape[2]
    basis = np.empty(SPAN)
    members, shares = np.empty(MOST + 1, np.int64), np.empty(MOST + 1)
    work = np.empty((MOST, MOST + 1))
    index = np.empty(REACH * freedoms, np.int64)
    row, miss = np.empty((2, REACH * freedoms)), np.empty(2)
    for j in range(len(moving)):
        own = np.flatnonzero(moving[j])
        size = len(own)
        for i in range(rays.starts[j], rays.starts[j + 1]):
            count, variance = whiten(rays, i, members, shares, work)
            oldest = rays.times[members[count - 1]]
            low = weights_at((oldest - grid.origin) / grid.step, grid.number, basis)
            row[:], miss[:] = 0.0, 0.0
            top = low + SPAN
            for m in range(count):
                n = members[m]
                k = weights_at((rays.times[n] - grid.origin) / grid.step, grid.number, basis)
                top = max(top, k + SPAN)
                scale = shares[m] / rays.sigmas[n]
                for e in range(2):
                    miss[e] += scale * misses[n, e]
                    for p in range(SPAN):
                        at = (k - low + p) * size
                        for a in range(size):
                            row[e, at + a] += scale * basis[p] * slopes[n, e, own[a]]
            for p in range(top - low):
                for a in range(size):
                    index[p * size + a] = (low + p) * freedoms + own[a]
            w = 1.0 / variance
            for a in range((top - low) * size):
                right[index[a]] -= w * (row[0, a] * miss[0] + row[1, a] * miss[1])
                for b in range(a + 1):
                    value = w * (row[0, a] * row[0, b] + row[1, a] * row[1, b])
                    columns[index[b], index[a] - index[b]] += value


@njit(cache=True, error_model="numpy", nogil=True)
def blocks_of(columns, size):
    """Return the blocks (K, R + 1, B, B) of a band of columns (K B, (R + 1) B), see `factor_blocks`.

    Args:
        size: B.
    """
    rows, width = columns.shape
    blocks = np.zeros((rows // size, width // size, size, size))
    for i in range(rows):
        for k in range(width - i % size):
            at = i % size + k
            blocks[i // size, at // size, at % size, i % size] = columns[i, k]
    return blocks


@njit(cache=True, error_model="numpy", nogil=True)
def squares_of(rays, misses):
    """Return the sum of the squares of the whitened misses (N, 2) m, in units of their variances."""
    members, shares = np.empty(MOST + 1, np.int64), np.empty(MOST + 1)
    work = np.empty((MOST, MOST + 1))
    total = 0.0
    for i in range(len(rays.times)):
        count, variance = whiten(rays, i, members, shares, work)
        for e in range(2):
            value = 0.0
            for m in range(count):
                value += shares[m] / rays.sigmas[members[m]] * misses[members[m], e]
            total += value * value / variance
    return total
