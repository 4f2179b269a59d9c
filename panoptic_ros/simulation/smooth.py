"""Smooth random functions of time, the basis of all motions.

Times are (T,) s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

Array = np.ndarray
WAVES = 3  # number of sinusoids in a `SmoothNoise`


@dataclass(frozen=True, eq=False)
class SmoothNoise:
    """Random signals, one per column: sums of sinusoids with a given root mean square."""

    scale: Array  # (C,) root mean square
    frequency: Array  # (WAVES, C) Hz
    phase: Array  # (WAVES, C) rad

    @classmethod
    def draw(cls, rng: np.random.Generator, scale: Sequence[float], low: float, high: float) -> SmoothNoise:
        """Draw signals with root mean squares `scale` and frequencies between `low` and `high` Hz."""
        shape = (WAVES, len(scale))
        return cls(np.array(scale), rng.uniform(low, high, shape), rng.uniform(0.0, 2.0 * np.pi, shape))

    def __call__(self, t: Array) -> Array:
        """Return the values (T, C) at times (T,) s."""
        angle = 2.0 * np.pi * self.frequency * t[:, None, None] + self.phase
        values: Array = self.scale * np.sqrt(2.0 / WAVES) * np.sin(angle).sum(axis=1)
        return values


@dataclass(frozen=True)
class Pulses:
    """Periodic bumps between 0 and 1 with long rests between them."""

    period: float  # s
    start: float  # s

    @classmethod
    def draw(cls, rng: np.random.Generator, low: float, high: float) -> Pulses:
        """Draw bumps with a period of `low` to `high` s."""
        period = float(rng.uniform(low, high))
        return cls(period, float(rng.uniform(0.0, period)))

    def __call__(self, t: Array) -> Array:
        """Return the values (T,) at times (T,) s."""
        return np.sin(np.pi * (t - self.start) / self.period) ** 4


def ease(x: Array) -> Array:
    """Return 0 for x <= 0 and 1 for x >= 1, with a continuous second derivative in between."""
    x = np.clip(x, 0.0, 1.0)
    eased: Array = x * x * x * (x * (6.0 * x - 15.0) + 10.0)
    return eased
