"""Positive matrices by LAPACK, whose calls cost less than what scipy checks before them."""

from __future__ import annotations

import numpy as np
from scipy.linalg import lapack

from panoptic_ros.errors import ContractError

Array = np.ndarray


def factor_of(matrix: Array) -> Array:
    """Lower Cholesky factor (N, N), 0 above its diagonal.

    Raises:
        ContractError: if there is none.
    """
    factor: Array
    factor, failed = lapack.dpotrf(matrix.T, lower=1)  # symmetric: its transpose is in LAPACK's order
    if failed:
        raise ContractError(f"a matrix of {len(matrix)} rows is not positive (row {failed})")
    return factor


def forward(factor: Array, rows: Array) -> Array:
    """factor^-1 rows, for a lower factor."""
    found: Array
    found, _ = lapack.dtrtrs(factor, rows, lower=1)
    return found


def solved_by(factor: Array, vector: Array) -> Array:
    """(factor factor^T)^-1 vector (N,)."""
    found, _ = lapack.dpotrs(factor, vector, lower=1)
    return np.ravel(found)


def inverse_of(matrix: Array) -> Array:
    """The inverse (N, N).

    Raises:
        ContractError: if the matrix is not positive.
    """
    half, _ = lapack.dpotri(factor_of(matrix), lower=1, overwrite_c=1)
    found: Array = half + half.T  # what is above the diagonal is 0
    found.ravel(order="K")[:: len(found) + 1] *= 0.5
    return found
