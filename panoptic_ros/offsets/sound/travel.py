"""How long sound travels to each microphone, where nobody knows from where it comes.

Sources stand somewhere between the microphones. So the time of travel to each is uncertain, together with
those to the others: that is a covariance. In a room it is larger than that of the straight ways: behind the
walls' echoes a sound rises later where it is heard from farther away.
"""
from __future__ import annotations

import numpy as np

Array = np.ndarray
SPEED_OF_SOUND = 343.0  # m/s
ROOM = 1.5  # delay of onsets per delay of the straight way, in rooms of .3 to .8 s of reverberation
ONSET_S = 1.5e-3  # that a room adds to each microphone, standard deviation
LEAST_RADIUS = 1.5  # m, around the middle of the microphones, in which sources stand
DEPTH = 0.5  # m below and above, the same
RINGS, SPOKES, LEVELS = 6, 24, 3
UNKNOWN = 0.3  # standard deviation of the way to a microphone, in units of the farthest distance of two


def travel(positions: Array) -> tuple[Array, Array]:
    """Mean (M,) s and covariance (M, M) s^2 of the delays of onsets at microphones (M, 3) m.

    Sources are taken to stand evenly in a disc around the middle of the microphones, up to the farthest.
    """
    middle = positions.mean(axis=0)
    radius = max(LEAST_RADIUS, float(np.linalg.norm((positions - middle)[:, :2], axis=1).max()))
    rings = radius * np.sqrt((np.arange(RINGS) + 0.5) / RINGS)
    angles = 2.0 * np.pi * np.arange(SPOKES) / SPOKES
    heights = np.linspace(-DEPTH, DEPTH, LEVELS)
    r, a, z = (grid.ravel() for grid in np.meshgrid(rings, angles, heights, indexing="ij"))
    sources = middle + np.stack([r * np.cos(a), r * np.sin(a), z], axis=1)
    delays = ROOM / SPEED_OF_SOUND * np.linalg.norm(sources[:, None] - positions, axis=2)
    covariance = np.cov(delays, rowvar=False, bias=True).reshape(len(positions), len(positions))
    return delays.mean(axis=0), covariance + ONSET_S**2 * np.eye(len(positions))


def unknown_travel(count: int, apart: float) -> tuple[Array, Array]:
    """The same for microphones somewhere up to `apart` m from each other."""
    deviation = ROOM * UNKNOWN * apart / SPEED_OF_SOUND
    return np.zeros(count), (deviation**2 + ONSET_S**2) * np.eye(count)
