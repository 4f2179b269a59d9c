"""Velocities of new joints, from views of different stamps.

Such views disagree because of motion, or because calibration and 2D joints are off. One joint in three views
cannot tell which: its velocity has as many unknowns as the views have residuals. All joints of a person
together can. Each joint's velocity has a normal prior of some scale, from slow to fast; how many joints are
of which scale, and a factor on the stated covariances that all joints share, follow from the likelihood
(empirical Bayes), and velocities are averaged over what is possible. Where views say little, joints are slow
rather than fast, and covariances state that they may be fast.
"""

from __future__ import annotations

import numpy as np

from panoptic_ros.geometry.robust import growth
from panoptic_ros.refinement.records import Motion

Array = np.ndarray

SCALES = 0.5 ** np.arange(6)  # of the largest speed, all as likely at first
FACTORS = 4.0 ** np.arange(6)  # on the stated covariances
ROUNDS = 3  # of expectation and maximisation
LEAST = 1e-300  # keeps logarithms finite


def started(points: Array, noises: Array, delays: Array, velocities: Array, spreads: Array) -> Motion:
    """Motion (J, 6) and (J, 6, 6) of J joints of which nothing else is known, from X + G V = points (J, 3).

    The velocities (J, 3) m/s have covariances `spreads` (J or 1, 3, 3), independent of the points' noises.
    """
    turned = delays @ spreads
    states, covariances = np.empty((len(points), 6)), np.empty((len(points), 6, 6))
    states[:, :3], states[:, 3:] = points - (delays @ velocities[..., None])[..., 0], velocities
    covariances[:, :3, :3] = noises + turned @ np.swapaxes(delays, 1, 2)
    covariances[:, :3, 3:], covariances[:, 3:, :3] = -turned, -np.swapaxes(turned, 1, 2)
    covariances[:, 3:, 3:] = spreads
    return Motion(states, covariances)


def likely_velocities(
    velocities: Array, information: Array, largest: float, cauchy: float
) -> tuple[Array, Array]:
    """Velocities (J, 3) m/s of a person's joints and their covariances (J, 3, 3).

    Args:
        velocities: (J, 3) m/s, as the views say. information: (J, 3, 3), inverse of their covariances, may be
            singular; 0 = says nothing.
        largest: m/s per axis, standard deviation of the velocities of fast joints.
        cauchy: sigmas, scale of the Cauchy weight of velocities that are too far off for any joint.
    """
    weights, axes = np.linalg.eigh(information)
    weights = np.maximum(weights, 0.0)
    seen = (np.swapaxes(axes, 1, 2) @ velocities[..., None])[..., 0]  # (J, 3), along the axes
    priors = ((largest * SCALES) ** 2)[:, None, None, None]
    factors = FACTORS[:, None, None]
    spread = factors + priors * weights  # (S, F, J, 3), of velocities in stated standard deviations
    grown = growth(weights * seen**2 / spread, cauchy)
    chances = _chances(np.where(weights > 0.0, np.log(spread) + cauchy**2 * np.log(grown), 0.0))
    noises = factors * grown / growth(1.0, cauchy)
    total = noises + priors * weights
    means, variances = priors * weights * seen / total, priors * noises / total
    mean = np.einsum("sfj,sfji->ji", chances, means)
    away = means - mean
    covariance = np.einsum("sfj,sfji,sfjk->jik", chances, away, away)
    covariance[:, range(3), range(3)] += np.einsum("sfj,sfji->ji", chances, variances)
    return (axes @ mean[..., None])[..., 0], axes @ covariance @ np.swapaxes(axes, 1, 2)


def _chances(costs: Array) -> Array:
    """Of scales and factors for each joint (S, F, J), from twice the negative log likelihood (S, F, J, 3)."""
    summed = 0.5 * costs.sum(axis=3)
    likelihoods = np.exp(summed.min(axis=(0, 1)) - summed)
    shares = np.full(len(SCALES), 1.0 / len(SCALES))  # of the joints that are of each scale
    chances: Array = likelihoods
    for _ in range(ROUNDS):
        weighted = shares[:, None, None] * likelihoods
        joints = np.maximum(weighted.sum(axis=0), LEAST)  # (F, J)
        evidence = np.log(joints).sum(axis=1)
        trust = np.exp(evidence - evidence.max())
        chances = weighted / joints * (trust / trust.sum())[:, None]
        shares = 1.0 + chances.sum(axis=(1, 2))
        shares /= shares.sum()
    return chances
