"""How joints go on: by accelerations at random, or by such that last for a while.

The acceleration is white noise of some spectral density q, m^2/s^3, that has passed a filter of first order
(Singer 1970): a' = (w - a) / memory, with the stationary variance q / (2 memory). Slow motion is the same for
every memory, and a memory of 0 is white acceleration, whose states need no acceleration. Results do not
depend on the frame rate.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

Array = np.ndarray
MOVING = 6  # numbers of a state of position and velocity
SIX, NINE = (0,) * MOVING, (0,) * 9  # as long as states without and with accelerations, for the compiler
SAME_AT = 8.0  # Hz, at which process noise means the same for every memory
NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)


class Transition(NamedTuple):
    """Of a state with N orders (position, velocity, acceleration), on each axis, over some time."""

    forward: Array  # (N, N) upper triangle, the state later by the state now
    spread: Array  # (N, N) covariance of what is added, for process noise of 1 m^2/s^3


def density(memory: float) -> float:
    """By which process noise is multiplied: accelerations that last have less of it at high rates."""
    return 1.0 + (2.0 * np.pi * SAME_AT * memory) ** 2


def lasting_variance(noise: Array, memory: float) -> Array:
    """m^2/s^4 per axis, of accelerations of which nothing is known, under process noise m^2/s^3."""
    return noise / (2.0 * memory) if memory > 0.0 else np.zeros_like(noise)


@lru_cache(maxsize=64)
def transition(dt: float, memory: float) -> Transition:
    """Over dt s."""
    if memory <= 0.0:
        spread = np.array([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]])
        return Transition(np.array([[1.0, dt], [0.0, 1.0]]), spread)
    share = dt / memory
    left = np.exp(-share)
    forward = np.array(
        [[1.0, dt, memory**2 * (share - 1.0 + left)], [0.0, 1.0, memory * (1.0 - left)], [0.0, 0.0, left]]
    )
    # by quadrature: what an impulse of the noise has become some time later
    times = 0.5 * dt * (NODES + 1.0)
    gone = -np.expm1(-times / memory)
    response = np.stack([times - memory * gone, gone, (1.0 - gone) / memory])
    return Transition(forward, (0.5 * dt * WEIGHTS * response) @ response.T)
