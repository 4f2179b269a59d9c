"""Model the travel time of sound from unknown sources to each microphone.

Sources stand somewhere between the microphones. The travel times to the microphones are therefore uncertain
and correlated, which a covariance describes. In a room the covariance is larger than that of the direct
paths. The reflections from the walls delay the onset more at distant microphones. The directness of a window
at each microphone gives a rough position of its source.
"""

from __future__ import annotations

import numpy as np

from panoptic_ros.offsets.sound.directness import HIGH, LOW, PARTS, Directness

Array = np.ndarray
SPEED_OF_SOUND = 343.0  # m/s
ROOM = 1.7  # onset delay over delay of the direct path, in rooms with 0.3 to 0.8 s of reverberation
ONSET_S = 1.5e-3  # s, standard deviation of the onset delay that a room adds at each microphone
LEAST_RADIUS = 1.5  # m, minimum radius of the disc of sources around the centre of the microphones
DEPTH = 0.5  # m, extent of the sources below and above the centre of the microphones
RINGS, SPOKES, LEVELS = 6, 24, 3
UNKNOWN = 0.3  # standard deviation of the path to a microphone over the largest distance of two microphones
# m, critical distances of rooms, where the direct sound is as loud as the reverberation
CRITICAL = np.geomspace(0.5, 1.6, 5)
CLOSEST = 0.3  # m, minimum distance of a source
NOISE = 0.15  # ratio of a microphone's noise energy to its signal energy
HEIGHT_LOG, TAIL_LOG = 0.5, 0.5  # standard deviations of the directness about its model: log height, tail


class SourcePositions:
    """Candidate source positions: uniform in a disc around the centre of the microphones.

    Its radius is the distance of the farthest microphone, at least `LEAST_RADIUS`.

    Args:
        positions: (M, 3) m, positions of the microphones.
    """

    def __init__(self, positions: Array):
        middle = positions.mean(axis=0)
        radius = max(LEAST_RADIUS, float(np.linalg.norm((positions - middle)[:, :2], axis=1).max()))
        rings = radius * np.sqrt((np.arange(RINGS) + 0.5) / RINGS)
        angles = 2.0 * np.pi * np.arange(SPOKES) / SPOKES
        heights = np.linspace(-DEPTH, DEPTH, LEVELS)
        r, a, z = (grid.ravel() for grid in np.meshgrid(rings, angles, heights, indexing="ij"))
        sources = middle + np.stack([r * np.cos(a), r * np.sin(a), z], axis=1)
        self._ways = np.linalg.norm(sources[:, None] - positions, axis=2)
        self._delays = ROOM / SPEED_OF_SOUND * self._ways

    def travel(self, heard: Directness) -> tuple[Array, Array]:
        """Return mean (M, K) s and covariance (M, M) s^2 of the onset delays in K windows.

        Delays are relative to their mean over the microphones.

        The posterior of the source position follows from Bayes' rule, averaged over rooms of every `CRITICAL`
        distance. The pairs of M devices carry no more information than M - 1 pairs, so their weight is
        reduced accordingly.
        """
        delays = self._delays - self._delays.mean(axis=1, keepdims=True)
        chance = self._chances(heard)
        means = chance @ delays
        apart = np.einsum("kx,xm,xn->mn", chance, delays, delays, optimize=True) - means.T @ means
        count = len(delays.T)
        return means.T, apart / max(1, len(chance)) + ONSET_S**2 * np.eye(count)

    def _chances(self, heard: Directness) -> Array:
        """Return the probability (K, X) of every source position in each window."""
        windows, count = heard.heights.shape[1], self._ways.shape[1]
        surprise = np.zeros((len(CRITICAL), windows, len(self._ways)))
        for row, critical in zip(surprise, CRITICAL):
            # energy ratio of the direct sound to the reverberation
            direct = (critical / np.maximum(self._ways, CLOSEST)) ** 2
            alike = _resultant(1.0 / (1.0 / direct + NOISE))
            follows = np.log1p(2.0 * direct)
            height = np.hypot(alike[:, heard.first] * alike[:, heard.second], _highest_of_noise())
            row += _misses(np.log(np.maximum(heard.heights, 1e-3)), np.log(height), HEIGHT_LOG)
            row += _misses(heard.tails, follows[:, heard.first] - follows[:, heard.second], TAIL_LOG)
        surprise *= 2.0 / count
        chance = np.exp(0.5 * (surprise.min(axis=(0, 2), keepdims=True) - surprise)).sum(axis=0)
        return np.asarray(chance / chance.sum(axis=1, keepdims=True))


def _resultant(ratio: Array) -> Array:
    """Return the mean cosine of the phase error that noise causes in a steady wave.

    Args:
        ratio: ratio of the energy of the wave to that of the noise.
    """
    from scipy.special import ive  # imported here: it loads slowly, and most runs do not need it

    half = 0.5 * ratio
    return np.asarray(0.5 * np.sqrt(np.pi * ratio) * (ive(0, half) + ive(1, half)))


def _highest_of_noise() -> float:
    """Return the approximate maximum of the correlation of unrelated phases."""
    return 3.5 / float(np.sqrt(2.0 * PARTS * (HIGH - LOW)))


def _misses(found: Array, model: Array, deviation: float) -> Array:
    """Return the squared residuals (K, X) of pairs (P, K) from models (X, P), summed over valid pairs."""
    there = np.isfinite(found).T.astype(float)
    values = np.nan_to_num(found).T
    total = (values**2).sum(axis=1, keepdims=True) - 2.0 * values @ model.T + there @ (model**2).T
    return np.asarray(total / deviation**2)


def unknown_travel(count: int, apart: float) -> tuple[Array, Array]:
    """Return mean (M, 1) s and covariance (M, M) s^2 of onset delays for unknown microphone positions.

    Args:
        count: number of microphones M.
        apart: (m) maximum distance of two microphones.
    """
    deviation = ROOM * UNKNOWN * apart / SPEED_OF_SOUND
    return np.zeros((count, 1)), (deviation**2 + ONSET_S**2) * np.eye(count)
