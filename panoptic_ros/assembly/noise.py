"""How noisy 2D joints are, learnt online from residuals: by score, by being hidden, by view and by size.

Detectors place joints relative to the person: a large one has larger errors in pixels. COCO's object keypoint
similarity takes errors as proportional to the size; nets of a coarse grid have a floor of some pixels. So
noise is size ** exponent, with an exponent between 0 and 1: the slope of log residuals over log sizes.
"""
from __future__ import annotations

import numpy as np

from panoptic_ros.kernels import njit

Array = np.ndarray

SCORE_BINS = 10
KINDS = 3  # of joints: visible, perhaps hidden, hidden (see `occlusion`)
LEVELS = 64  # bins of the histogram over the logarithm of residuals
LEVEL_RANGE = (0.02, 50.0)  # residual / initial sigma
RAYLEIGH_MEDIAN = 1.17741  # of a 2D residual with standard deviation 1 per axis
PRIOR_COUNT = 40.0  # weight of the initial values, in residuals
HIDDEN_PRIOR_COUNT = 5.0  # the same for joints that are hidden or may be, which are few
VIEW_PRIOR_COUNT = 200.0
GROWTH_PRIOR = 20.0  # weight of the exponent 0, in residuals times variance of their log sizes
CLIP = 4.0  # of log residuals; outliers are clipped to it
REACH = 1.4  # of log sizes from their mean, at which they are clipped
SMALLEST = 1e-4  # of a size: people of one joint have none


class NoiseTable:
    """Standard deviations of 2D joints as a share of the image's diagonal.

    sigma = share[kind, score bin] * factor[camera] * growth(size of the person). The first two are medians
    of residuals (with leverage taken out), so they adapt to calibration errors of whole views however wrong
    the start was, and outliers do not matter; for the third see `NoiseGrowth`. Deterministic: a function of
    the residuals in their order.

    Sizes are those of 2D people as a share of the image's diagonal, see `box_diagonals`.
    """

    def __init__(self, cameras: int, initial: float, memory: float):
        self._initial, self._memory = initial, memory
        self._low, high = np.log(LEVEL_RANGE[0]), np.log(LEVEL_RANGE[1])
        self._width = (high - self._low) / LEVELS
        self._scores = np.zeros((KINDS * SCORE_BINS, LEVELS))
        self._views = np.zeros((cameras, LEVELS))
        middle = int((np.log(RAYLEIGH_MEDIAN) - self._low) / self._width)
        self._scores[:, middle] = HIDDEN_PRIOR_COUNT
        self._scores[:SCORE_BINS, middle] = PRIOR_COUNT
        self._views[:, middle] = VIEW_PRIOR_COUNT
        self.shares = np.full(KINDS * SCORE_BINS, initial)
        self.factors = np.ones(cameras)
        self.growth = NoiseGrowth(memory)
        self.learnt = False  # whether any residual was used

    def sigmas(self, scores: Array, kinds: Array, cameras: Array, sizes: Array, diagonals: Array) -> Array:
        """Standard deviations (D, J) px of joints of scores and kinds (D, J).

        Args:
            cameras, sizes: (D,) of the 2D people. diagonals: (C,) px.
        """
        scales = (self.factors * diagonals)[cameras] * self.growth.factors(sizes)
        sigmas: Array = look_up(scores, kinds, self.shares, scales)
        return sigmas

    def learn(
        self, scores: Array, kinds: Array, cameras: Array, sizes: Array, pixels: Array, diagonals: Array
    ) -> None:
        """Update with residuals (N,) px, without leverage, of joints of scores, kinds and cameras (N,).

        Args:
            sizes: (N,) of the 2D people that the joints belong to. diagonals: (C,) px.
        """
        if not len(pixels):
            return
        self.learnt = True
        bins = bins_of(scores, kinds)
        share = pixels / diagonals[cameras]
        self.growth.learn(sizes, share / self.factors[cameras] / self.shares[bins])
        share = share / self.growth.factors(sizes)
        self.shares = self._initial * self._median(
            self._scores, bins, share / self.factors[cameras] / self._initial
        )
        self.factors = self._median(self._views, cameras, share / self.shares[bins])

    def _median(self, table: Array, rows: Array, ratios: Array) -> Array:
        """Count residuals in units of sigma into a histogram, with forgetting; sigma (R,) of each row."""
        count_levels(table, rows, ratios, self._low, self._width)
        levels: Array = np.exp(self._low + self._width * forget_and_halve(table, self._memory))
        return levels / RAYLEIGH_MEDIAN


@njit(cache=True)
def bins_of(scores, kinds):
    """Bins (N,) of scores in 0..1 and kinds."""
    result = np.empty(len(scores), np.int64)
    for i in range(len(scores)):
        result[i] = SCORE_BINS * kinds[i] + min(int(scores[i] * SCORE_BINS), SCORE_BINS - 1)
    return result


@njit(cache=True)
def look_up(scores, kinds, shares, scales):
    """The loops of `NoiseTable.sigmas`, with scales (D,) px of the 2D people."""
    result = np.empty(scores.shape)
    for d in range(scores.shape[0]):
        for j in range(scores.shape[1]):
            bin_of_score = min(int(scores[d, j] * SCORE_BINS), SCORE_BINS - 1)
            result[d, j] = shares[SCORE_BINS * kinds[d, j] + bin_of_score] * scales[d]
    return result


@njit(cache=True)
def count_levels(table, rows, ratios, low, width):
    """Count ratios (N,), at the levels of their logarithms, into these rows of a histogram, in place."""
    for i in range(len(rows)):
        level = (np.log(max(ratios[i], 1e-9)) - low) / width
        table[rows[i], int(min(max(level, 0.0), LEVELS - 1.0))] += 1.0


@njit(cache=True)
def forget_and_halve(table, memory):
    """Scale rows of a histogram (R, L) down to `memory` entries, in place.

    Returns:
        (R,) the median of each row in levels, interpolated inside of its level.
    """
    result = np.empty(len(table))
    for i in range(len(table)):
        total = 0.0
        for k in range(table.shape[1]):
            total += table[i, k]
        kept = min(1.0, memory / total)
        for k in range(table.shape[1]):
            table[i, k] *= kept
        half, below, level = 0.5 * kept * total, 0.0, 0
        while level < table.shape[1] - 1 and below + table[i, level] < half:
            below += table[i, level]
            level += 1
        result[i] = level + (half - below) / max(table[i, level], 1e-9)
    return result


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
        slope = (xy_sum - x_sum * y_sum / count) / (spread + GROWTH_PRIOR)
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
