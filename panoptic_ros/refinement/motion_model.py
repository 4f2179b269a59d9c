"""Motion models of joints: white acceleration, or correlated acceleration (Singer 1970).

The correlated acceleration is white noise w of spectral density q, m^2/s^3, behind a first-order filter: a' =
(w - a) / memory. Its stationary variance is q / (2 memory). Slow motion has the same statistics for every
memory. A memory of 0 gives white acceleration, and the state then needs no acceleration. Results do not
depend on the frame rate.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

Array = np.ndarray
MOVING = 6  # length of a state of position and velocity
SIX, NINE = (0,) * MOVING, (0,) * 9  # as long as states without and with acceleration: select a kernel
SAME_AT = 8.0  # Hz, frequency at which every memory gives the same spectral density
NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)


class StateTransition(NamedTuple):
    """Propagation of a state over some time, equal on each axis.

    The state has N orders: position, velocity and, for N = 3, acceleration.
    """

    forward: Array  # (N, N) upper triangle, maps the state to the later state
    spread: Array  # (N, N) added covariance for process noise of 1 m^2/s^3


def density(memory: float) -> float:
    """Return the factor on the process noise of accelerations with this memory, s.

    The filter of the acceleration attenuates high frequencies. The factor restores the spectral density at
    `SAME_AT`.
    """
    return 1.0 + (2.0 * np.pi * SAME_AT * memory) ** 2


def lasting_variance(noise: Array, memory: float) -> Array:
    """Return the stationary variance, m^2/s^4 per axis, of an acceleration under process noise m^2/s^3."""
    return noise / (2.0 * memory) if memory > 0.0 else np.zeros_like(noise)


@lru_cache(maxsize=64)
def transition(dt: float, memory: float) -> StateTransition:
    """Return the transition over dt s for accelerations with this memory, s; 0 = white."""
    if memory <= 0.0:
        spread = np.array([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]])
        return StateTransition(np.array([[1.0, dt], [0.0, 1.0]]), spread)
    share = dt / memory
    left = np.exp(-share)
    forward = np.array(
        [[1.0, dt, memory**2 * (share - 1.0 + left)], [0.0, 1.0, memory * (1.0 - left)], [0.0, 0.0, left]]
    )
    # Gauss-Legendre quadrature over the time since an impulse of the noise
    times = 0.5 * dt * (NODES + 1.0)
    gone = -np.expm1(-times / memory)
    response = np.stack([times - memory * gone, gone, (1.0 - gone) / memory])
    return StateTransition(forward, (0.5 * dt * WEIGHTS * response) @ response.T)
