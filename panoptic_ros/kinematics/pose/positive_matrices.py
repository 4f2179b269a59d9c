"""Positive definite matrices by direct LAPACK calls. These cost less than scipy's checks of its inputs."""

from __future__ import annotations

import numpy as np
from scipy.linalg import lapack

from panoptic_ros.errors import ContractError

Array = np.ndarray


def factor_of(matrix: Array) -> Array:
    """Return the lower Cholesky factor (N, N), with zeros above the diagonal.

    Raises:
        ContractError: If the matrix is not positive definite.
    """
    factor: Array
    # a symmetric matrix equals its transpose, whose memory order is LAPACK's
    factor, failed = lapack.dpotrf(matrix.T, lower=1)
    if failed:
        raise ContractError(f"a matrix of {len(matrix)} rows is not positive (row {failed})")
    return factor


def forward(factor: Array, rows: Array) -> Array:
    """Return factor^-1 rows, for a lower triangular factor."""
    found: Array
    found, _ = lapack.dtrtrs(factor, rows, lower=1)
    return found


def solved_by(factor: Array, vector: Array) -> Array:
    """Return (factor factor^T)^-1 vector (N,)."""
    found, _ = lapack.dpotrs(factor, vector, lower=1)
    return np.ravel(found)


def inverse_of(matrix: Array) -> Array:
    """Return the inverse (N, N).

    Raises:
        ContractError: If the matrix is not positive definite.
    """
    half, _ = lapack.dpotri(factor_of(matrix), lower=1, overwrite_c=1)
    # `half` is 0 above its diagonal; the diagonal counts twice here and is halved below
    found: Array = half + half.T
    found.ravel(order="K")[:: len(found) + 1] *= 0.5
    return found
