"""Lengths of a person's bones: learnt online, then soft constraints on the joints."""
from __future__ import annotations

import numpy as np

Array = np.ndarray

MEMORY = 300.0  # frames that a length remembers
GOOD_SIGMA = 0.04  # m, joints less certain than this teach nothing
OUTLIER = 3.0  # sigmas; lengths further from the mean teach and pull less


class BoneLengths:
    """Mean length of each bone of one person.

    The mean of |a - b| over noisy joints is too long by the noise across the bone; that is
    subtracted.
    """

    def __init__(self, bones: Array):
        self._bones = bones
        self.means = np.zeros(len(bones))
        self.counts = np.zeros(len(bones))

    def learn(self, positions: Array, covariances: Array, measured: Array) -> None:
        """Take joints (J, 3) m with covariances (J, 3, 3)."""
        for i, (a, b) in enumerate(self._bones):
            if not (measured[a] and measured[b]):
                continue
            spread = covariances[a] + covariances[b]
            if np.trace(spread) > 6.0 * GOOD_SIGMA**2:
                continue
            offset = positions[b] - positions[a]
            length = float(np.linalg.norm(offset))
            if length < 1e-3:
                continue
            unit = offset / length
            along = float(unit @ spread @ unit)
            corrected = length - 0.5 * (float(np.trace(spread)) - along) / length
            self.counts[i] = min(self.counts[i] + 1.0, MEMORY)
            surprise = corrected - self.means[i]
            limit = OUTLIER * np.sqrt(along + 0.01**2)
            if self.counts[i] > 5.0:
                surprise = float(np.clip(surprise, -limit, limit))
            self.means[i] += surprise / self.counts[i]

    def apply(
        self, positions: Array, covariances: Array, there: Array, sigma: float, frames: int
    ) -> tuple[Array, Array]:
        """Joints and covariances pulled towards the learnt lengths, less certain joints more.

        One pass along the tree from the root, each bone a scalar measurement of both ends.
        """
        positions, covariances = positions.copy(), covariances.copy()
        for i, (a, b) in enumerate(self._bones):
            if self.counts[i] < frames or not (there[a] and there[b]):
                continue
            offset = positions[b] - positions[a]
            length = float(np.linalg.norm(offset))
            if length < 1e-3:
                continue
            unit = offset / length
            gain_a, gain_b = covariances[a] @ unit, covariances[b] @ unit
            expected = float(unit @ (gain_a + gain_b))
            surprise = self.means[i] - length
            noise = sigma**2 * (1.0 + surprise**2 / (OUTLIER**2 * (expected + sigma**2)))
            total = expected + noise
            positions[a] -= gain_a * surprise / total
            positions[b] += gain_b * surprise / total
            covariances[a] -= np.outer(gain_a, gain_a) / total
            covariances[b] -= np.outer(gain_b, gain_b) / total
        return positions, covariances
