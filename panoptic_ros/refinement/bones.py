"""Lengths of a person's bones: learnt online, then soft constraints on the joints."""
from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit

Array = np.ndarray

MEMORY = 300.0  # frames over which a length is averaged
GOOD_SIGMA = 0.04  # m, joints less certain than this are not learnt from
OUTLIER = 3.0  # sigmas from the mean, beyond which a length has less weight
SHORTEST = 1e-3  # m, below which a bone has no direction
EXTRA_SIGMA = 0.01  # m, of a length besides the noise of its ends, when outliers are judged
SETTLED = 5.0  # frames after which outliers are cut


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
        """Update with joints (J, 3) m of covariances (J, 3, 3) m^2."""
        learn_lengths(self.means, self.counts, self._bones, positions, covariances, measured)

    def apply(
        self, positions: Array, covariances: Array, there: Array, sigma: float, frames: int
    ) -> tuple[Array, Array]:
        """Joints and covariances pulled towards the learnt lengths, less certain joints more.

        One pass along the tree from the root, each bone a scalar measurement of both ends.
        """
        positions, covariances = positions.copy(), covariances.copy()
        usable = self.counts >= frames
        pull_bones(positions, covariances, self._bones, self.means, usable, there, sigma)
        return positions, covariances


@njit(cache=True, error_model="numpy")
def learn_lengths(means, counts, bones, positions, covariances, measured):
    """Update means (B,) and counts (B,) of bones (B, 2) in place."""
    for i in range(len(bones)):
        a, b = bones[i]
        if not (measured[a] and measured[b]):
            continue
        trace = along = square = 0.0
        for k in range(3):
            trace += covariances[a, k, k] + covariances[b, k, k]
            square += (positions[b, k] - positions[a, k]) ** 2
        length = np.sqrt(square)
        if trace > 6.0 * GOOD_SIGMA**2 or length < SHORTEST:
            continue
        for k in range(3):
            for m in range(3):
                spread = covariances[a, k, m] + covariances[b, k, m]
                along += (positions[b, k] - positions[a, k]) * spread * (positions[b, m] - positions[a, m])
        along /= square
        counts[i] = min(counts[i] + 1.0, MEMORY)
        innovation = length - 0.5 * (trace - along) / length - means[i]
        limit = OUTLIER * np.sqrt(along + EXTRA_SIGMA**2)
        if counts[i] > SETTLED:
            innovation = min(limit, max(-limit, innovation))
        means[i] += innovation / counts[i]


@njit(cache=True, error_model="numpy")
def pull_bones(positions, covariances, bones, means, usable, there, sigma):
    """Take the usable lengths as measurements of noise sigma m, in place."""
    unit, gain_a, gain_b = np.empty(3), np.empty(3), np.empty(3)
    for i in range(len(bones)):
        a, b = bones[i]
        if not usable[i] or not (there[a] and there[b]):
            continue
        square = 0.0
        for k in range(3):
            unit[k] = positions[b, k] - positions[a, k]
            square += unit[k] ** 2
        length = np.sqrt(square)
        if length < SHORTEST:
            continue
        expected = 0.0
        for k in range(3):
            gain_a[k] = gain_b[k] = 0.0
            for m in range(3):
                gain_a[k] += covariances[a, k, m] * unit[m] / length
                gain_b[k] += covariances[b, k, m] * unit[m] / length
            expected += unit[k] / length * (gain_a[k] + gain_b[k])
        innovation = means[i] - length
        noise = sigma**2 * (1.0 + innovation**2 / (OUTLIER**2 * (expected + sigma**2)))
        total = expected + noise
        for k in range(3):
            positions[a, k] -= gain_a[k] * innovation / total
            positions[b, k] += gain_b[k] * innovation / total
            for m in range(3):
                covariances[a, k, m] -= gain_a[k] * gain_a[m] / total
                covariances[b, k, m] -= gain_b[k] * gain_b[m] / total
