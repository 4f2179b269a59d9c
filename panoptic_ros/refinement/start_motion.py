"""Velocities of new joints, from views with different timestamps.

Such views disagree because of motion, or because calibration and 2D joints are wrong. One joint in three
views cannot separate these causes: its velocity has as many unknowns as the views have residuals. All joints
of a person together can.

The velocity of each joint has a normal prior with one of several scales, from slow to fast. All joints share
a factor on the stated covariances. The likelihood determines this factor and the share of joints per scale
(empirical Bayes). The velocity of a joint is the mean over all scales and factors, weighted by their
probabilities. If the views contain little information, the estimates are slow, and their covariances include
fast motion.
"""

from __future__ import annotations

import numpy as np

from panoptic_ros.geometry.robust import growth
from panoptic_ros.refinement.records import Motion

Array = np.ndarray

SCALES = 0.5 ** np.arange(6)  # prior scales relative to the largest; equally probable at first
FACTORS = 4.0 ** np.arange(6)  # factors on the stated covariances
ROUNDS = 3  # rounds of expectation maximisation
LEAST = 1e-300  # lower bound of likelihoods, keeps logarithms finite


def started(points: Array, noises: Array, delays: Array, velocities: Array, spreads: Array) -> Motion:
    """Return the states (J, 6) and covariances (J, 6, 6) of J new joints, from points = X + G V.

    Args:
        points: (J, 3) m.
        noises: (J, 3, 3) m^2, covariances of the points.
        delays: (J, 3, 3) s, G.
        velocities: (J, 3) m/s, V.
        spreads: (J or 1, 3, 3) m^2/s^2, covariances of the velocities, independent of the noise of the
            points.
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
    """Return the velocities (J, 3) m/s of a person's joints, and their covariances (J, 3, 3) m^2/s^2.

    Args:
        velocities: (J, 3) m/s, measured by the views.
        information: (J, 3, 3) s^2/m^2, their inverse covariances. A matrix may be singular; 0 = not measured.
        largest: Standard deviation of the velocities of fast joints, m/s per axis.
        cauchy: Scale of the Cauchy weight on implausible velocities, in standard deviations.
    """
    weights, axes = np.linalg.eigh(information)
    weights = np.maximum(weights, 0.0)
    seen = (np.swapaxes(axes, 1, 2) @ velocities[..., None])[..., 0]  # (J, 3) m/s, along eigenvectors
    priors = ((largest * SCALES) ** 2)[:, None, None, None]
    factors = FACTORS[:, None, None]
    spread = factors + priors * weights  # (S, F, J, 3), expected / stated variance
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
    """Return the probabilities (S, F, J) of scales and factors for each joint.

    Args:
        costs: (S, F, J, 3) twice the negative log likelihood.
    """
    summed = 0.5 * costs.sum(axis=3)
    likelihoods = np.exp(summed.min(axis=(0, 1)) - summed)
    shares = np.full(len(SCALES), 1.0 / len(SCALES))  # share of joints of each scale
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
