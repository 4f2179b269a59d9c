"""Energy of one segment, E = -E_sim + alpha E_lim, and its minimum (paper, 4.3 and 4.4).

The paper descends along the gradient with one step length per coefficient. Levenberg and Marquardt's steps
with the same gradient take some ten iterations instead of hundreds, and end at the same minimum. All terms
are similarities of Gaussians: their matrix is that of the quadratic function that bounds each from above.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from panoptic_ros.continuous.elhayek.polynomials import basis, gauss_points, place

Array = np.ndarray
LIMIT_WEIGHT = 0.1  # alpha (paper, 5); its unit follows from areas in rad times frames of the slowest camera
# Gauss points of the integrals over a segment. Their weights add up to 2: the frames of a segment.
POINTS = 8
REST = 1e-3  # 1/rad^2 or 1/m^2, weight that keeps at rest what nothing determines, as the twist of a straight arm
ITERATIONS = 15  # maximum number of steps
LEAST_GAIN = 1e-6  # decrease of the energy below which the minimum is reached
DAMPING, MOST_DAMPING = 1e-3, 1e6


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
        terms: measurements; their energies are added.
        limits: (D, 2), see `Skeleton`.
        start: (D, L) coefficients from which the fit starts.
    """

    def __init__(self, segment: Array, terms: Sequence[PoseTerm], limits: Array, start: Array):
        self._terms = list(terms)
        self._limits, self._start = limits, start
        self._bases = [basis(place(term.times, *segment), start.shape[1]) for term in self._terms]

    def data(self, coefficients: Array) -> CoefficientSums:
        """Return the terms of the measurements."""
        total, gradient = 0.0, np.zeros_like(coefficients)
        matrix = np.zeros((*coefficients.shape, *coefficients.shape))
        for term, values in zip(self._terms, self._bases):
            found = term.sums(values @ coefficients.T)
            total += found.energy
            gradient += found.gradients.T @ values
            matrix += _lifted(found.matrices, values)
        return CoefficientSums(total, gradient, matrix)

    def covariance(self, coefficients: Array) -> Array:
        """Return the covariance (D L, D L) of the coefficients at the minimum."""
        size = coefficients.size
        matrix = np.zeros((*coefficients.shape, *coefficients.shape))
        most = 1.0
        for term, values in zip(self._terms, self._bases):
            freedoms = values @ coefficients.T
            precision = term.precision(freedoms, size)
            matrix += precision * _lifted(term.sums(freedoms).matrices, values)
            most = max(most, precision)
        found: Array = np.linalg.inv(matrix.reshape(size, size) + most * REST * np.eye(size))
        return found

    def sums(self, coefficients: Array) -> CoefficientSums:
        """Return the whole energy."""
        energy, gradient, matrix = self.data(coefficients)
        limits = limit_sums(coefficients, self._limits)
        energy += LIMIT_WEIGHT * limits.energy
        gradient = gradient + LIMIT_WEIGHT * limits.gradient
        matrix = matrix + LIMIT_WEIGHT * limits.matrix
        away = coefficients.copy()
        away[:, 0] -= self._start[:, 0]
        energy += 0.5 * REST * float((away**2).sum())
        size = coefficients.size
        square = matrix.reshape(size, size)
        square[np.diag_indices(size)] += REST
        return CoefficientSums(energy, gradient + REST * away, matrix)


def _lifted(matrices: Array, values: Array) -> Array:
    """Return the sum over instants of pose matrices (T, D, D) as a matrix (D, L, D, L) of coefficients.

    Args:
        values: (T, L) polynomials at the instants.
    """
    size, count = matrices.shape[1], values.shape[1]
    pairs = (values[:, :, None] * values[:, None, :]).reshape(len(values), -1)
    product = matrices.reshape(len(values), -1).T @ pairs
    found: Array = product.reshape(size, size, count, count).transpose(0, 2, 1, 3)
    return found


def limit_sums(coefficients: Array, limits: Array) -> CoefficientSums:
    """Return the squared areas beyond the limits, summed over degrees of freedom (equation 8 of the paper).

    Args:
        coefficients: (D, L) of a segment.
        limits: (D, 2) lower and upper limits.
    """
    size, count = coefficients.shape
    places, weights = gauss_points(POINTS)
    values = basis(places, count)
    motion = coefficients @ values.T  # (D, Q)
    below = np.maximum(limits[:, :1] - motion, 0.0)
    above = np.maximum(motion - limits[:, 1:], 0.0)
    areas = (below + above) @ weights
    slopes = ((above > 0.0) * weights - (below > 0.0) * weights) @ values  # (D, L)
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
        size = len(gradient)
        matrix = sums.matrix[:, :order, :, :order].reshape(size, size)
        gain = 0.0
        while damping < MOST_DAMPING:
            damped = matrix + damping * np.diag(np.diag(matrix))
            step = np.zeros_like(found)
            step[:, :order] = -np.linalg.solve(damped, gradient).reshape(-1, order)
            tried = energy.sums(found + step)
            gain = sums.energy - tried.energy
            if gain > 0.0:
                found, sums, damping = found + step, tried, 0.1 * damping
                break
            damping *= 10.0
        if gain <= LEAST_GAIN:
            break
    return found
