"""How long sound travels to each microphone, where nobody knows from where it comes.

Sources stand somewhere between the microphones. So the time of travel to each is uncertain, together with
those to the others: that is a covariance. In a room it is larger than that of the straight ways: behind the
walls' echoes a sound rises later where it is heard from farther away. How directly each microphone hears a
window tells where its source stands, roughly.
"""

from __future__ import annotations

import numpy as np

from panoptic_ros.offsets.sound.directness import HIGH, LOW, PARTS, Directness

Array = np.ndarray
SPEED_OF_SOUND = 343.0  # m/s
ROOM = 1.7  # delay of onsets per delay of the straight way, in rooms of .3 to .8 s of reverberation
ONSET_S = 1.5e-3  # that a room adds to each microphone, standard deviation
LEAST_RADIUS = 1.5  # m, around the middle of the microphones, in which sources stand
DEPTH = 0.5  # m below and above, the same
RINGS, SPOKES, LEVELS = 6, 24, 3
UNKNOWN = 0.3  # standard deviation of the way to a microphone, in units of the farthest distance of two
CRITICAL = np.geomspace(0.5, 1.6, 5)  # m, where the direct sound of rooms is as loud as their tail
CLOSEST = 0.3  # m
NOISE = 0.15  # energy of a microphone's noise over that of what it hears
HEIGHT_LOG, TAIL_LOG = 0.5, 0.5  # standard deviations of what directness is beside its model


class Places:
    """Where sources may be: evenly in a disc around the middle of the microphones, up to the farthest.

    Args:
        positions: (M, 3) m of the microphones.
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
        """Mean (M, K) s and covariance (M, M) s^2 of the delays of onsets in K windows, beside their mean.

        The posterior of the place by Bayes, evenly over rooms of every `CRITICAL` distance. Pairs of M
        devices tell what M - 1 would, so they count that much less.
        """
        delays = self._delays - self._delays.mean(axis=1, keepdims=True)
        chance = self._chances(heard)
        means = chance @ delays
        apart = np.einsum("kx,xm,xn->mn", chance, delays, delays, optimize=True) - means.T @ means
        count = len(delays.T)
        return means.T, apart / max(1, len(chance)) + ONSET_S**2 * np.eye(count)

    def _chances(self, heard: Directness) -> Array:
        """(K, X) of every place in each window."""
        windows, count = heard.heights.shape[1], self._ways.shape[1]
        surprise = np.zeros((len(CRITICAL), windows, len(self._ways)))
        for row, critical in zip(surprise, CRITICAL):
            direct = (critical / np.maximum(self._ways, CLOSEST)) ** 2  # energy over that of the tail
            alike = _resultant(1.0 / (1.0 / direct + NOISE))
            follows = np.log1p(2.0 * direct)
            height = np.hypot(alike[:, heard.first] * alike[:, heard.second], _highest_of_noise())
            row += _misses(np.log(np.maximum(heard.heights, 1e-3)), np.log(height), HEIGHT_LOG)
            row += _misses(heard.tails, follows[:, heard.first] - follows[:, heard.second], TAIL_LOG)
        surprise *= 2.0 / count
        chance = np.exp(0.5 * (surprise.min(axis=(0, 2), keepdims=True) - surprise)).sum(axis=0)
        return np.asarray(chance / chance.sum(axis=1, keepdims=True))


def _resultant(ratio: Array) -> Array:
    """Mean cosine between the phase of a steady wave and that of it with noise, by their energies' ratio."""
    from scipy.special import ive  # takes long to load, which most runs do not need

    half = 0.5 * ratio
    return np.asarray(0.5 * np.sqrt(np.pi * ratio) * (ive(0, half) + ive(1, half)))


def _highest_of_noise() -> float:
    """Of the correlation of phases that have nothing to do with each other, about the highest value."""
    return 3.5 / float(np.sqrt(2.0 * PARTS * (HIGH - LOW)))


def _misses(found: Array, model: Array, deviation: float) -> Array:
    """Squared misses (K, X) of what pairs (P, K) found beside models (X, P), summed over what was found."""
    there = np.isfinite(found).T.astype(float)
    values = np.nan_to_num(found).T
    total = (values**2).sum(axis=1, keepdims=True) - 2.0 * values @ model.T + there @ (model**2).T
    return np.asarray(total / deviation**2)


def unknown_travel(count: int, apart: float) -> tuple[Array, Array]:
    """The same for microphones somewhere up to `apart` m from each other, in any window: (M, 1), (M, M)."""
    deviation = ROOM * UNKNOWN * apart / SPEED_OF_SOUND
    return np.zeros((count, 1)), (deviation**2 + ONSET_S**2) * np.eye(count)
