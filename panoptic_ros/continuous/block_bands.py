"""Symmetric positive definite systems of equal blocks in a band: factor, solution, covariances in the band.

A matrix of K blocks of B unknowns is stored as its lower band (K, R + 1, B, B): blocks[k, p] = A[k + p, k].
Blocks beyond the last row are 0. All heavy work is in products of blocks, which BLAS computes.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.linalg import LinAlgError, lapack
from scipy.linalg.blas import dgemm

Array = np.ndarray


def factor_blocks(blocks: Array) -> None:
    """Replace blocks (K, R + 1, B, B) by their factor, A = L D L^T.

    The diagonal blocks of L are 1. blocks[k, 0] becomes the inverse of D[k]; blocks[k, p], L[k + p, k].

    Raises:
        LinAlgError: if A is not positive definite.
    """
    count, width, size, _ = blocks.shape
    for k in range(count):
        reach = min(width, count - k) - 1
        own = _inverse(blocks[k, 0])
        below = blocks[k, 1 : reach + 1].copy()
        gains = blocks[k, 1 : reach + 1].reshape(-1, size)
        np.matmul(below.reshape(-1, size), own, out=gains)
        for p in range(reach):
            later = blocks[k + 1 + p, : reach - p].reshape(-1, size)
            # later -= gains @ below^T, in place: a transposed array of C order is one of Fortran order
            dgemm(-1.0, below[p].T, gains[p * size :].T, 1.0, later.T, trans_a=1, overwrite_c=1)
        blocks[k, 0] = own


def _inverse(matrix: Array) -> Array:
    """Return the inverse of a positive definite matrix (B, B), of which the lower triangle is read."""
    factor, failed = lapack.dpotrf(matrix.T, lower=0)
    if failed:
        raise LinAlgError(f"the leading minor {failed} is not positive")
    upper = lapack.dpotri(factor, lower=0)[0]
    own: Array = np.where(np.tri(len(upper), dtype=bool), upper.T, upper)
    return own


def solve_blocks(factor: Array, right: Array) -> Array:
    """Return the solution (K, B) of A x = right, from the factor of `factor_blocks`."""
    count, width, size, _ = factor.shape
    found: Array = right.copy()
    for k in range(count):
        reach = min(width, count - k) - 1
        found[k + 1 : k + 1 + reach] -= factor[k, 1 : reach + 1] @ found[k]
    for k in range(count - 1, -1, -1):
        reach = min(width, count - k) - 1
        gains = factor[k, 1 : reach + 1].reshape(-1, size)
        found[k] = factor[k, 0] @ found[k] - found[k + 1 : k + 1 + reach].ravel() @ gains
    return found


def covariances_in_band(factor: Array) -> Iterator[tuple[int, Array, Array, Array]]:
    """Yield the covariances in the band, from the last block to the first (Takahashi's recursion).

    Block m has the slot m % R among later blocks, so that nothing moves from one step to the next.

    Yields: index k of a block, and its covariance (B, B). Then the covariance (R, B, B) of later blocks with
        it, and that of later blocks (R, B, R, B), both by slot. They are 0 beyond the last block.
    """
    count, width, size, _ = factor.shape
    reach = width - 1
    later = np.zeros((reach, size, reach, size))
    flat = later.reshape(reach * size, reach * size)
    gains, cross = np.empty((reach, size, size)), np.empty((reach * size, size))
    for k in range(count - 1, -1, -1):
        gains[(k + 1 + np.arange(reach)) % reach] = factor[k, 1:]
        np.matmul(flat, gains.reshape(-1, size), out=cross)
        np.negative(cross, out=cross)
        here = factor[k, 0] - gains.reshape(-1, size).T @ cross
        here = 0.5 * (here + here.T)  # asymmetric errors would grow from block to block
        shaped = cross.reshape(reach, size, size)
        yield k, here, shaped, later
        slot = k % reach
        later[:, :, slot] = shaped
        later[slot] = shaped.transpose(2, 0, 1)
        later[slot, :, slot] = here
