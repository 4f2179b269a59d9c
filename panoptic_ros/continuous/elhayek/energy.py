"""Energy of one segment, E = -E_sim + alpha E_lim, and its minimum (paper, 4.3 and 4.4).

The paper descends along the gradient with one step length per coefficient. Levenberg and Marquardt's steps
with the same gradient take some ten iterations instead of hundreds. Similarities are sums of Gaussians: their
matrix is that of the quadratic function that bounds each from above.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.polynomial.legendre import leggauss, legvander

from panoptic_ros.continuous.elhayek.polynomials import basis

Array = np.ndarray
LIMIT_WEIGHT = 0.1  # alpha (paper, 5); its unit follows from areas in rad times frames of the slowest camera
POINTS = 16  # Gauss points of the integrals over a segment; their weights add up to 2, its length in frames
REST = 1e-3  # 1/rad^2 or 1/m^2, keeps what nothing determines near the start, as the twist of a straight arm
VAGUE = 10.0  # 1/rad^2 or 1/m^2, information about what nothing determines: standard deviation 0.3
ITERATIONS = 15  # maximum number of steps
LEAST_GAIN = 1e-6  # decrease of the energy below which the minimum is reached
DAMPING, MOST_DAMPING = 1e-3, 1e6  # relative to the diagonal of the matrix


class PoseSums(NamedTuple):
    """Energy of poses at T instants, with derivatives by their D degrees of freedom.

    Args:
        energy: sum over the instants.
        gradients: (T, D).
        matrices: (T, D, D), positive semidefinite approximations of the second derivatives.
    """

    energy: float
    gradients: Array
    matrices: Array


class PoseTerm(Protocol):
    """Negative similarity of poses to the measurements at `times` (T,) s."""

    times: Array

    def sums(self, freedoms: Array) -> PoseSums:
        """Return the energy of degrees of freedom (T, D)."""
        ...

    def precision(self, freedoms: Array, spent: int) -> float:
        """Return the factor from the matrices of `sums` to the information of the measurements.

        Args:
            freedoms: (T, D) at the minimum.
            spent: number of coefficients that were fitted.
        """
        ...


class CoefficientSums(NamedTuple):
    """Energy of the coefficients (D, L) of a segment, gradient (D, L) and matrix (D, L, D, L)."""

    energy: float
    gradient: Array
    matrix: Array


class SegmentEnergy:
    """Energy of the motion function of one segment.

    Args:
        segment: (2,) s, first and last instant.
        term: measurements.
        limits: (D, 2), see `HingeSkeleton`.
        start: (D, L) coefficients from which the fit starts.
    """

    def __init__(self, segment: Array, term: PoseTerm, limits: Array, start: Array):
        self._term, self._limits, self._start = term, limits, start
        self._basis = basis(term.times, segment, start.shape[1])

    def sums(self, coefficients: Array) -> CoefficientSums:
        """Return the energy and its derivatives."""
        data = self._term.sums(self._basis @ coefficients.T)
        limits = limit_sums(coefficients, self._limits)
        away = coefficients - self._start
        matrix = _lifted(data.matrices, self._basis) + LIMIT_WEIGHT * limits.matrix
        size = coefficients.size
        matrix.reshape(size, size)[np.diag_indices(size)] += REST
        return CoefficientSums(
            data.energy + LIMIT_WEIGHT * limits.energy + 0.5 * REST * float((away**2).sum()),
            data.gradients.T @ self._basis + LIMIT_WEIGHT * limits.gradient + REST * away,
            matrix,
        )

    def covariance(self, coefficients: Array) -> Array:
        """Return the covariance (D, L, D, L) of the coefficients at the minimum."""
        freedoms, size = self._basis @ coefficients.T, coefficients.size
        matrix = _lifted(self._term.sums(freedoms).matrices, self._basis).reshape(size, size)
        known = self._term.precision(freedoms, size) * matrix + VAGUE * np.eye(size)
        covariance: Array = np.linalg.inv(known).reshape(*coefficients.shape, *coefficients.shape)
        return covariance


def _lifted(matrices: Array, values: Array) -> Array:
    """Return the sum over instants of pose matrices (T, D, D) as a matrix (D, L, D, L) of coefficients.

    Args:
        values: (T, L) polynomials at the instants.
    """
    size, count = matrices.shape[1], values.shape[1]
    pairs = (values[:, :, None] * values[:, None, :]).reshape(len(values), -1)
    product = matrices.reshape(len(values), -1).T @ pairs
    found = product.reshape(size, size, count, count).transpose(0, 2, 1, 3)
    return np.ascontiguousarray(found)


def limit_sums(coefficients: Array, limits: Array) -> CoefficientSums:
    """Return the squared areas beyond the limits, summed over degrees of freedom (equation 8 of the paper).

    Args:
        coefficients: (D, L) of a segment.
        limits: (D, 2) lower and upper limits.
    """
    size, count = coefficients.shape
    places, weights = leggauss(POINTS)
    values = legvander(places, count - 1)
    motion = coefficients @ values.T  # (D, Q)
    below = np.maximum(limits[:, :1] - motion, 0.0)
    above = np.maximum(motion - limits[:, 1:], 0.0)
    areas = (below + above) @ weights
    slopes = (np.sign(above) - np.sign(below)) * weights @ values  # (D, L)
    matrix = np.zeros((size, count, size, count))
    each = np.arange(size)
    matrix[each, :, each, :] = 2.0 * slopes[:, :, None] * slopes[:, None, :]
    return CoefficientSums(float((areas**2).sum()), 2.0 * areas[:, None] * slopes, matrix)


def minimise(energy: SegmentEnergy, start: Array, order: int) -> Array:
    """Return the coefficients (D, L) of least energy near `start`.

    Args:
        order: number of coefficients of each degree of freedom that may change: 1 = a constant pose.
    """
    found, damping = start, DAMPING
    sums = energy.sums(found)
    for _ in range(ITERATIONS):
        gradient = sums.gradient[:, :order].ravel()
        matrix = sums.matrix[:, :order, :, :order].reshape(len(gradient), -1)
        gain = 0.0
        while damping < MOST_DAMPING and gain <= 0.0:
            step = np.zeros_like(found)
            damped = matrix + damping * np.diag(np.diag(matrix))
            step[:, :order] = -np.linalg.solve(damped, gradient).reshape(-1, order)
            tried = energy.sums(found + step)
            gain = sums.energy - tried.energy
            damping *= 0.1 if gain > 0.0 else 10.0
        if gain > 0.0:
            found, sums = found + step, tried
        if gain <= LEAST_GAIN:
            break
    return found
