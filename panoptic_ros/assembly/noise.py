"""How noisy 2D joints are, learnt online from residuals: by score, by being hidden, by view and by size.

Detectors place joints relative to the person: a large one has larger errors in pixels. COCO's object keypoint
similarity takes errors as proportional to the size; nets of a coarse grid have a floor of some pixels. So
noise is size ** exponent, with an exponent between 0 and 1: the slope of log residuals over log sizes.

Residuals are of well-supported joints, and their leverage is taken out (`residuals_to_learn`).
"""
from __future__ import annotations

import numpy as np

from panoptic_ros.geometry.symmetric import invert_symmetric
from panoptic_ros.kernels import njit
from panoptic_ros.solving.scene import MIN_DEPTH

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
MOST = 1000  # residuals per instant, about
THINNING = 1e7  # the digits of an observation that say whether it is taken
LEVERAGE = 0.7  # residuals of observations that decide alone say nothing
TWO_VIEW_LEVERAGE = 0.9
TWO_VIEW_FACTOR = 1.2345  # two views leave one residual: |N(0, 1)| has another median than a 2D length


class NoiseTable:
    """Standard deviations of 2D joints as a share of the image's diagonal.

    sigma = share[kind, score bin] * factor[camera] * growth(size of the person). The first two are medians
    of residuals (with leverage taken out), so they adapt to calibration errors of whole views however wrong
    the start was, and outliers do not matter; for the third see `NoiseGrowth`. Deterministic: a function of
    the residuals in their order.

    Sizes are those of 2D people as a share of the image's diagonal, see `solving.evidence.box_diagonals`.
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


@njit(cache=True, error_model="numpy")
def residuals_to_learn(kept, solved, shifts, seen, focals):
    """Rows (N,), joints (N,) and residuals (N,) px of observations of the people `kept` (P,).

    They come from joints of three and more views, and from those of two only if there are no others. Of too
    many residuals about every n-th is used, chosen by the digits of its observation, so that the order of the
    views does not matter. Observations outside of the gate are used too: their residuals are noise.

    Args:
        solved: `SolvedJoints`. shifts: (P, J, 3) m/s, velocities by which views were moved to the set's
            instant. seen: `Observations`. focals: (V,) px.
    """
    positions, normals, residuals, picks = solved
    plane, precision = seen.plane, seen.precision
    joints, views = residuals.shape[1:]
    rotations, translations, delays = seen.cams
    support = np.zeros((len(kept), joints), np.int64)
    few = True
    for i in range(len(kept)):
        for j in range(joints):
            if np.isfinite(positions[kept[i], j, 0]):
                for v in range(views):
                    support[i, j] += residuals[kept[i], j, v] >= 0.0
                few &= support[i, j] < 3
    least = 2 if few else 3
    count = 0
    for i in range(len(kept)):
        for j in range(joints):
            if support[i, j] >= least:
                for v in range(views):
                    count += picks[kept[i], j, v, 0] >= 0
    stride = 1 + count // MOST
    rows, columns = np.empty(count, np.int64), np.empty(count, np.int64)
    pixels, spread = np.empty(count), np.zeros((3, 3))
    taken = 0
    for i in range(len(kept)):
        p = kept[i]
        for j in range(joints):
            if support[i, j] < least:
                continue
            invert_symmetric(normals[p, j], 1.0, spread)
            for v in range(views):
                d, s = picks[p, j, v]
                if d < 0:
                    continue
                if stride > 1 and np.int64(THINNING * abs(plane[d, s, 0] + plane[d, s, 1])) % stride:
                    continue
                x = (
                    positions[p, j, 0] + shifts[p, j, 0] * delays[v],
                    positions[p, j, 1] + shifts[p, j, 1] * delays[v],
                    positions[p, j, 2] + shifts[p, j, 2] * delays[v],
                )
                error, leverage = _residual(
                    x, spread, rotations[v], translations[v], plane[d, s], precision[d, s]
                )
                if residuals[p, j, v] < 0.0:
                    leverage = 0.0
                if leverage < (TWO_VIEW_LEVERAGE if few else LEVERAGE):
                    rows[taken], columns[taken] = d, s
                    pixels[taken] = error * focals[v] / np.sqrt(max(1.0 - leverage, 0.1))
                    if few:
                        pixels[taken] *= TWO_VIEW_FACTOR
                    taken += 1
    return rows[:taken], columns[:taken], pixels[:taken]


@njit(cache=True, error_model="numpy")
def _residual(x, spread, rotation, translation, point, precision):
    """Distance on the plane between a joint and its observation, and the leverage of that observation.

    spread: (3, 3) m^2, inverse of the normal matrix of the joint.
    """
    x0, x1, x2 = x
    r = rotation
    z = translation[2] + r[2, 0] * x0 + r[2, 1] * x1 + r[2, 2] * x2
    inverse = 1.0 / max(z, MIN_DEPTH)
    u = (translation[0] + r[0, 0] * x0 + r[0, 1] * x1 + r[0, 2] * x2) * inverse
    w = (translation[1] + r[1, 0] * x0 + r[1, 1] * x1 + r[1, 2] * x2) * inverse
    row = np.empty(3)
    error = np.sqrt((point[0] - u) ** 2 + (point[1] - w) ** 2)
    total = 0.0  # trace of J N^-1 J^T
    for i in range(2):
        slope = u if i == 0 else w
        for k in range(3):
            row[k] = r[i, k] - slope * r[2, k]
        for k in range(3):
            for m in range(3):
                total += row[k] * spread[k, m] * row[m]
    return error, 0.5 * total * inverse * inverse * precision * precision
