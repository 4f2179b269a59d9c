"""Process noise and the scale of covariances, learnt online from the innovations of a filter.

Innovations, whitened by their stated covariance, of a filter whose model is right have variance 1 and
no correlation over time (Mehra 1970). If two in a row point the same way, the filter follows too slowly
and needs more process noise; if they alternate, it follows noise and needs less. That does not depend on
the scale of the noise. With process noise so, their mean square tells the scale of all covariances.

Errors of a detector that last for some frames look like motion: then innovations two and three frames
apart have opposite signs, because the filter follows an error and comes back. Smoothed joints are then less
certain. By how much was found approximately, by simulation of such errors.
"""
from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit

Array = np.ndarray

CLIP = 3.0  # sigmas, at which innovations are clipped
FIRST = 4  # measurements of a person before process noise is learnt
SETTLED = 10  # and before the scale is; earlier innovations depend on the prior of velocities
RATE = 0.2  # of the logarithm of the process noise, per measurement and unit of correlation
RANGE = (0.1, 10.0)  # of the factor on the process noise
PRIOR = 8.0  # weight of the scale 1, in measurements of a person
MEMORY = 100.0  # measurements of a person
LASTING_PRIOR, LASTING_MEMORY = 60.0, 1000.0  # measurements of people
LASTING_FREE = 0.06  # correlation, two and three frames apart, that is no sign of lasting errors
LASTING_GAIN = 8.0  # growth of covariances per unit of it beyond


class LastingErrors:
    """How much larger covariances are because errors last: a property of the detector, from all people."""

    def __init__(self) -> None:
        self._weight, self._correlation = LASTING_PRIOR, 0.0

    def learn(self, correlation: float, share: float) -> None:
        """Take the sum of the correlations two and three frames apart, of a share of a person's joints."""
        self._weight = min(self._weight + share, LASTING_MEMORY)
        self._correlation += (correlation - self._correlation) * share / self._weight

    @property
    def factor(self) -> float:
        """On all covariances, 1 or more."""
        return 1.0 + LASTING_GAIN * max(0.0, -self._correlation - LASTING_FREE)


class Tuning:
    """Of one person of J joints: `factor` on its process noise, and the `scale` of its covariances."""

    def __init__(self, joints: int, lasting: LastingErrors):
        self._joints, self._lasting = joints, lasting
        self.factor = self._level = 1.0
        self._weight, self._seen = PRIOR, 0
        self._before = np.full((3, joints, 3), np.nan)  # innovations of one, two, three measurements ago

    @property
    def scale(self) -> float:
        """By which covariances of the filter and smoother are to be multiplied."""
        return self._level * self._lasting.factor

    def learn(self, innovations: Array) -> None:
        """Take whitened innovations (J, 3), NaN = not measured."""
        count, square, next_sum, late_sum = innovation_sums(innovations, self._before)
        self._before = np.concatenate([innovations[None], self._before[:2]])
        self._seen += 1
        if self._seen <= FIRST or not count:
            return
        change = RATE * next_sum / (3.0 * self._joints) / self._level
        self.factor = min(max(self.factor * np.exp(change), RANGE[0]), RANGE[1])
        if self._seen <= SETTLED:
            return
        share = count / self._joints
        self._weight = min(self._weight + share, MEMORY)
        self._level += (square / (3.0 * count) - self._level) * share / self._weight
        self._lasting.learn(late_sum / (3.0 * count) / self._level, share)


@njit(cache=True, error_model="numpy")
def innovation_sums(now, before):
    """Of innovations (J, 3), clipped: number, sum of squares, sums of products over time.

    Args:
        before: (3, J, 3) the last ones. The sums of products are with the last one, and with the two
            before that together.
    """
    count = 0
    square = next_sum = late_sum = 0.0
    for j in range(len(now)):
        if not np.isfinite(now[j, 0]):
            continue
        count += 1
        for i in range(3):
            value = min(CLIP, max(-CLIP, now[j, i]))
            square += value * value
            for k in range(3):
                if np.isfinite(before[k, j, 0]):
                    product = value * min(CLIP, max(-CLIP, before[k, j, i]))
                    if k == 0:
                        next_sum += product
                    else:
                        late_sum += product
    return count, square, next_sum, late_sum
