"""Normal distributions as linear algebra tells them."""

import numpy as np


def positive(rng, size, scale):
    """A random covariance (size, size) of about this standard deviation."""
    factor = scale * rng.standard_normal((size, size))
    return factor @ factor.T + 1e-3 * scale**2 * np.eye(size)


def conditioned(state, covariance, matrix, value, noise):
    """Mean and covariance of a state (N,) once matrix (M, N) of it was measured, with covariance noise."""
    gain = covariance @ matrix.T @ np.linalg.inv(matrix @ covariance @ matrix.T + noise)
    return state + gain @ (value - matrix @ state), covariance - gain @ matrix @ covariance
