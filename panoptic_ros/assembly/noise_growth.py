"""How the noise of 2D joints grows with the size of a person in the image, learnt online.

Detectors place joints relative to the person: a large one has larger errors in pixels. COCO's object keypoint
similarity takes errors as proportional to the size; nets of a coarse grid have a floor of some pixels. So
noise is size ** exponent, with an exponent between 0 and 1: the slope of log residuals over log sizes.
"""
from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit

Array = np.ndarray

PRIOR = 20.0  # weight of the exponent 0, in residuals times variance of their log sizes
CLIP = 4.0  # of log residuals; outliers are clipped to it
REACH = 1.4  # of log sizes from their mean, at which they are clipped
SMALLEST = 1e-4  # of a size: people of one joint have none


class NoiseGrowth:
    """The exponent, by linear regression with forgetting.

    Attributes:
        exponent: 0 = noise does not depend on size, 1 = it is proportional.
    """

    def __init__(self, memory: float):
        self._memory = memory
        self._sums = np.zeros(5)  # 1, x, y, x x, x y with x the log of sizes, y of residuals
        self._middle = 0.0  # mean log size, at which the factor is 1
        self.exponent = 0.0

    def factors(self, sizes: Array) -> Array:
        """Noise (N,) of people of sizes (N,), relative to that of the mean size."""
        factors: Array = growth_factors(sizes, self._middle, self.exponent)
        return factors

    def learn(self, sizes: Array, ratios: Array) -> None:
        """Update with residuals (N,), in units of the noise at the mean size, of people of sizes (N,)."""
        add_logs(self._sums, sizes, ratios)
        self._sums *= min(1.0, self._memory / self._sums[0])
        count, x_sum, y_sum, xx_sum, xy_sum = self._sums.tolist()
        self._middle = x_sum / count
        spread = xx_sum - x_sum * x_sum / count
        slope = (xy_sum - x_sum * y_sum / count) / (spread + PRIOR)
        self.exponent = min(max(slope, 0.0), 1.0)


@njit(cache=True)
def growth_factors(sizes, middle, exponent):
    """The loop of `NoiseGrowth.factors`."""
    result = np.empty(len(sizes))
    for i in range(len(sizes)):
        away = np.log(max(sizes[i], SMALLEST)) - middle
        result[i] = np.exp(exponent * min(REACH, max(-REACH, away)))
    return result


@njit(cache=True)
def add_logs(sums, sizes, ratios):
    """Add to sums (5,), in place, the number of residuals and the sums of x, y, x x, x y."""
    for i in range(len(sizes)):
        x = np.log(max(sizes[i], SMALLEST))
        y = min(CLIP, max(-CLIP, np.log(max(ratios[i], 1e-9))))
        sums[0] += 1.0
        sums[1] += x
        sums[2] += y
        sums[3] += x * x
        sums[4] += x * y


@njit(cache=True)
def box_diagonals(plane, scores):
    """Diagonals (D,) of the boxes of the joints plane (D, J, 2) that have a score (D, J)."""
    result = np.zeros(len(plane))
    for d in range(len(plane)):
        left = top = np.inf
        right = bottom = -np.inf
        for j in range(plane.shape[1]):
            if scores[d, j] > 0.0:
                left, right = min(left, plane[d, j, 0]), max(right, plane[d, j, 0])
                top, bottom = min(top, plane[d, j, 1]), max(bottom, plane[d, j, 1])
        if right >= left:
            result[d] = np.sqrt((right - left) ** 2 + (bottom - top) ** 2)
    return result
