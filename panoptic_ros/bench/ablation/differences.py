"""What figures change by, pair by pair, and whether that is more than chance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

CONFIDENCE = 0.95


@dataclass(frozen=True)
class Difference:
    """A mean change of a figure.

    Args:
        mean: NaN if no pair has the figure.
        error: its standard error, NaN of a single pair.
        freedom: degrees of freedom of the error, 0 of a single pair.
    """

    mean: float
    error: float
    freedom: float

    @property
    def clear(self) -> bool:
        """Whether chance alone would seldom do as much (Student's t, 95 %)."""
        if not self.freedom > 0.0 or not self.error >= 0.0 or self.mean == 0.0:
            return False
        return abs(self.mean) > float(student.ppf(0.5 + 0.5 * CONFIDENCE, self.freedom)) * self.error


def paired(off: Sequence[float], default: Sequence[float]) -> Difference:
    """The mean of off - default over samples (seeds, or stretches of a recording) that have both."""
    changes = np.subtract(off, default)
    changes = changes[np.isfinite(changes)]
    count = len(changes)
    if count < 2:
        return Difference(float(changes[0]) if count else math.nan, math.nan, 0.0)
    return Difference(float(changes.mean()), float(changes.std(ddof=1) / math.sqrt(count)), count - 1.0)


def over_scenes(differences: Sequence[Difference]) -> Difference:
    """The mean over scenes, each with the same weight, whatever its number of samples.

    The degrees of freedom are those of Welch and Satterthwaite.
    """
    known = [d for d in differences if math.isfinite(d.mean)]
    if not known:
        return Difference(math.nan, math.nan, 0.0)
    mean = sum(d.mean for d in known) / len(known)
    if any(not math.isfinite(d.error) for d in known):
        return Difference(mean, math.nan, 0.0)
    squares = [d.error**2 for d in known]
    spread = sum(square**2 / d.freedom for square, d in zip(squares, known))
    freedom = sum(squares) ** 2 / spread if spread else sum(d.freedom for d in known)
    return Difference(mean, math.sqrt(sum(squares)) / len(known), freedom)
