"""Certainty of the clocks and line delays that the motion of people determines."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from panoptic_ros.solving.clock_gauge import acquainted

Array = np.ndarray


def known_clocks(covariance: Array, limit: float) -> Array:
    """Return the cameras (C,) whose clocks are known relative to each other; none, if fewer than two.

    Args:
        covariance: (C, C) of offsets or drifts.
        limit: greatest standard deviation of what is known.
    """
    members = acquainted(covariance, limit)
    inside = covariance[np.ix_(members, members)]
    variances = np.diag(inside) - 2.0 * inside.mean(axis=1) + inside.mean()
    known: Array = members & (members.sum() > 1) & (variances.max() <= limit**2)
    return known


def certain(information: Array, blur: Array) -> Array:
    """Return the information (U, U) without that of noise, which looks like motion of people who stand.

    Args:
        blur: (U, U) expected information of noise.
    """
    scale = np.sqrt(np.maximum(np.diag(information), 1e-30))
    values, vectors = np.linalg.eigh((information - blur) / np.outer(scale, scale))
    kept: Array = (vectors * np.maximum(values, 0.0)) @ vectors.T * np.outer(scale, scale)
    return kept


def covariance_of(information: Array, weights: Array, unknown: Array) -> Array:
    """Return the covariance (U, U) of all values, known values have covariance 0.

    Args:
        information: (U, U).
        weights: (U,) information of the prior.
        unknown: indices of the unknowns.
    """
    covariance = np.zeros_like(information)
    covariance[np.ix_(unknown, unknown)] = np.linalg.inv(
        (information + np.diag(weights))[np.ix_(unknown, unknown)]
    )
    return covariance


def robust_covariance(information: Array, scatter: Array, weights: Array, unknown: Array) -> Array:
    """Return the covariance (U, U) of values whose noise may be other than assumed; see `covariance_of`.

    The scatter of the scores of independent segments is their true information if the noise is as assumed.
    Where the scatter is larger, the covariance is that of Godambe (1960), H^-1 J H^-1. So it is for people
    who sit: their motion is hardly larger than the noise, whose persistence is only known roughly. So it is
    for real detectors, whose errors joints share.

    Args:
        scatter: (U, U) sum of the products of the scores of segments, J.
    """
    inside = np.ix_(unknown, unknown)
    covariance = np.zeros_like(information)
    if not len(unknown):
        return covariance
    prior = np.diag(weights[unknown])
    factor = cholesky(information[inside] + prior, lower=True)
    half = solve_triangular(factor, scatter[inside] + prior, lower=True)
    values, vectors = np.linalg.eigh(solve_triangular(factor, half.T, lower=True))
    root = solve_triangular(factor, vectors, lower=True, trans="T") * np.sqrt(np.maximum(values, 1.0))
    covariance[inside] = root @ root.T
    return covariance
