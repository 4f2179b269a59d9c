"""How noisy 2D joints are, learnt online from residuals: by score, by being hidden, by view and by size.

Residuals are of well-supported joints, and their leverage is taken out (`residuals`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import Evidence
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.kernels import njit

Array = np.ndarray

SCORE_BINS = 10
KINDS = 3  # of joints: visible, perhaps hidden, hidden (see `occlusion`)
LEVELS = 64  # bins of the histogram over the logarithm of residuals
LEVEL_RANGE = (0.02, 50.0)  # residual / initial sigma
LOW = float(np.log(LEVEL_RANGE[0]))
WIDTH = (float(np.log(LEVEL_RANGE[1])) - LOW) / LEVELS
RAYLEIGH_MEDIAN = 1.17741  # of a 2D residual with standard deviation 1 per axis
MOST_OF, RAYLEIGH_MOST = 0.9, 2.14597  # a quantile, and that of such a residual
PRIOR_COUNT = 20.0  # weight of the initial values, in residuals
HIDDEN_PRIOR_COUNT = 2.5  # the same for joints that are hidden or may be, which are few
VIEW_PRIOR_COUNT = 100.0
SIZE_PRIOR = 10.0  # weight of the slope 0, in residuals times variance of their log sizes
REACH, CLIP = 1.4, 4.0  # of log sizes about their mean, and of log residuals
CARRIED_NOISE = 0.022  # of the diagonal of a 2D person, after a second of being carried by motion


class Marks(NamedTuple):
    """D 2D people of J joints: see `Evidence`.

    kinds (D, J) of the joints; cameras (D,); sizes (D,) of the people, diagonals of their boxes on the plane,
    as large as they are in the image; ages (D,) s, for which each was carried.
    """

    plane: Array
    magnification: Array
    scores: Array
    kinds: Array
    cameras: Array
    sizes: Array
    ages: Array

    @classmethod
    def of(cls, evidence: Evidence, kinds: Array, ages: Array) -> Marks:
        """Those of an instant."""
        shown = evidence.plane, evidence.magnification, evidence.scores
        return cls(*shown, kinds, evidence.cameras[evidence.view], sizes_of(*shown), ages)


class Shares(NamedTuple):
    """What is learnt: histograms of residuals, scores (B, LEVELS) by kind and score, and views (C, LEVELS) by
    camera; shares (B,) of the diagonal, factors (C,) and tails (B,) that follow from them. Of log residuals y
    over log sizes x the sums (5,) of 1, x, y, x^2, x y; growth (2,), the mean of x and the slope.
    """

    scores: Array
    views: Array
    shares: Array
    factors: Array
    tails: Array
    sums: Array
    growth: Array


class NoiseTable:
    """Standard deviations of 2D joints as a share of the image's diagonal.

    sigma = share[kind, score bin] * factor[camera] * size ** slope. Shares and factors are medians of
    residuals (with leverage taken out), so they adapt to calibration errors of whole views however wrong the
    start was, and outliers do not matter. A net errs by a share of the person (a slope of 1, as in COCO's
    object keypoint similarity) or of its grid (0). Deterministic: a function of the residuals in their order.

    Of many views those that err are found out. Where two or one show a joint they are not, and all residuals
    count: their tail, the deviation that nine of ten show over that of half of them.
    """

    def __init__(self, cameras: int, initial: float, memory: float):
        self._initial, self._memory = initial, memory
        scores, views = np.zeros((KINDS * SCORE_BINS, LEVELS)), np.zeros((cameras, LEVELS))
        middle = int((np.log(RAYLEIGH_MEDIAN) - LOW) / WIDTH)
        scores[:, middle], views[:, middle] = HIDDEN_PRIOR_COUNT, VIEW_PRIOR_COUNT
        scores[:SCORE_BINS, middle] = PRIOR_COUNT
        shares, tails = np.full(len(scores), initial), np.ones(len(scores))
        self._learnt = Shares(scores, views, shares, np.ones(cameras), tails, np.zeros(5), np.zeros(2))
        self.learnt = False  # whether any residual was used

    def precisions(self, marks: Marks, rig: RigArrays) -> Array:
        """1 / standard deviation (D, J) on the normalised plane of 2D joints, 0 = missing.

        People who were carried have gone astray by a random walk besides.
        """
        precisions: Array = look_up(marks, self._learnt, rig.focals, rig.diagonals)
        return precisions

    def tails(self, marks: Marks) -> Array:
        """By which the standard deviations (D, J) of 2D joints are larger where few views show a joint."""
        tails: Array = tails_of(marks, self._learnt.tails)
        return tails

    def learn(self, marks: Marks, residuals: tuple[Array, Array, Array], rig: RigArrays) -> None:
        """Update with residuals: rows (N,) and joints (N,) of the marks, and px (N,) without leverage.

        People who were carried teach nothing.
        """
        start = self._initial, self._memory
        self.learnt |= count_residuals(marks, residuals, self._learnt, rig.focals, rig.diagonals, start)


@njit(cache=True, error_model="numpy")
def look_up(marks, learnt, focals, diagonals):
    """The loops of `NoiseTable.precisions`; focals, diagonals: (C,) px."""
    result = np.zeros(marks.scores.shape)
    for d in range(len(result)):
        camera = marks.cameras[d]
        pixels = marks.sizes[d] * focals[camera]
        growth = _growth(learnt, pixels / diagonals[camera])
        scale, astray = learnt.factors[camera] * growth * diagonals[camera], 0.0
        if marks.ages[d] > 0.0:
            astray = CARRIED_NOISE * np.sqrt(marks.ages[d]) * pixels
        for j in range(result.shape[1]):
            if marks.scores[d, j] > 0.0:
                sigma = np.hypot(learnt.shares[_bin(marks, d, j)] * scale, astray)
                result[d, j] = focals[camera] * marks.magnification[d, j] / sigma
    return result


@njit(cache=True, error_model="numpy")
def tails_of(marks, tails):
    """The loops of `NoiseTable.tails`."""
    result = np.ones(marks.scores.shape)
    for d, j in np.ndindex(marks.scores.shape):
        if marks.scores[d, j] > 0.0:
            result[d, j] = tails[_bin(marks, d, j)]
    return result


@njit(cache=True, error_model="numpy")
def _bin(marks, d, j):
    """The bin of a 2D joint, by kind and score."""
    return SCORE_BINS * marks.kinds[d, j] + min(int(marks.scores[d, j] * SCORE_BINS), SCORE_BINS - 1)


@njit(cache=True, error_model="numpy")
def _growth(learnt, size):
    """Noise of a person of some size, a share of the image's diagonal, relative to that of the mean size."""
    middle, slope = learnt.growth
    away = np.log(size) - middle if size > 0.0 else 0.0  # people of one joint have none
    return np.exp(slope * min(REACH, max(-REACH, away)))


@njit(cache=True, error_model="numpy")
def sizes_of(plane, magnification, scores):
    """`Marks.sizes`."""
    sizes = np.zeros(len(plane))
    for d in range(len(plane)):
        left = top = np.inf
        right = bottom = -np.inf
        zoom, count = 0.0, 0
        for j in range(scores.shape[1]):
            if scores[d, j] > 0.0:
                left, right = min(left, plane[d, j, 0]), max(right, plane[d, j, 0])
                top, bottom = min(top, plane[d, j, 1]), max(bottom, plane[d, j, 1])
                zoom, count = zoom + magnification[d, j], count + 1
        if count:
            sizes[d] = np.hypot(right - left, bottom - top) * zoom / count
    return sizes


@njit(cache=True, error_model="numpy")
def count_residuals(marks, residuals, learnt, focals, diagonals, start):
    """The loops of `NoiseTable.learn`, in place; whether there were any.

    Args:
        focals, diagonals: (C,) px. start: initial share and memory.
    """
    (rows, joints, pixels), (initial, memory) = residuals, start
    shares, used = np.full(len(rows), np.nan), 0
    bins, sizes = np.empty(len(rows), np.int64), np.empty(len(rows))
    for i in range(len(rows)):
        d, camera = rows[i], marks.cameras[rows[i]]
        if marks.ages[d] > 0.0:
            continue
        used += 1
        shares[i] = pixels[i] * marks.magnification[d, joints[i]] / diagonals[camera]
        bins[i], sizes[i] = _bin(marks, d, joints[i]), marks.sizes[d] * focals[camera] / diagonals[camera]
        level = _level(shares[i] / (learnt.factors[camera] * _growth(learnt, sizes[i]) * initial))
        learnt.scores[bins[i], level] += 1.0
    if used == 0:
        return False
    _forget(learnt.scores, memory)
    for k in range(len(learnt.shares)):
        half = _quantile(learnt.scores[k], 0.5) / RAYLEIGH_MEDIAN
        learnt.tails[k] = max(1.0, _quantile(learnt.scores[k], MOST_OF) / RAYLEIGH_MOST / half)
        learnt.shares[k] = half * initial
    for i in range(len(rows)):
        if np.isfinite(shares[i]):
            camera, ratio = marks.cameras[rows[i]], shares[i] / learnt.shares[bins[i]]
            learnt.views[camera, _level(ratio / _growth(learnt, sizes[i]))] += 1.0
            if sizes[i] > 0.0:
                _add(learnt.sums, np.log(sizes[i]), np.log(max(ratio / learnt.factors[camera], 1e-9)))
    _forget(learnt.views, memory)
    for k in range(len(learnt.factors)):
        learnt.factors[k] = _quantile(learnt.views[k], 0.5) / RAYLEIGH_MEDIAN
    _solve_growth(learnt, memory)
    return True


@njit(cache=True, error_model="numpy")
def _add(sums, x, y):
    """Add a log size and a log residual to the sums of the regression, in place."""
    y = min(CLIP, max(-CLIP, y))
    sums[0] += 1.0
    sums[1] += x
    sums[2] += y
    sums[3] += x * x
    sums[4] += x * y


@njit(cache=True, error_model="numpy")
def _solve_growth(learnt, memory):
    """The mean log size, and the slope of log residuals over log sizes, in place."""
    learnt.sums[:] *= min(1.0, memory / max(learnt.sums[0], 1.0))
    count, x, y, xx, xy = learnt.sums
    middle = x / max(count, 1.0)
    slope = (xy - middle * y) / (xx - middle * x + SIZE_PRIOR)
    learnt.growth[0], learnt.growth[1] = middle, min(max(slope, 0.0), 1.0)


@njit(cache=True, error_model="numpy")
def _level(ratio):
    """The level of a residual in units of sigma."""
    level = (np.log(max(ratio, 1e-9)) - LOW) / WIDTH
    return int(min(max(level, 0.0), LEVELS - 1.0))


@njit(cache=True, error_model="numpy")
def _forget(table, memory):
    """Scale rows of a histogram (R, L) down to `memory` entries, in place."""
    for i in range(len(table)):
        total = 0.0
        for k in range(table.shape[1]):
            total += table[i, k]
        kept = min(1.0, memory / total)
        for k in range(table.shape[1]):
            table[i, k] *= kept


@njit(cache=True, error_model="numpy")
def _quantile(row, share):
    """The residual that this share of a histogram (L,) stays below, interpolated inside of its level."""
    total = 0.0
    for k in range(len(row)):
        total += row[k]
    wanted, below, level = share * total, 0.0, 0
    while level < len(row) - 1 and below + row[level] < wanted:
        below += row[level]
        level += 1
    return np.exp(LOW + WIDTH * (level + (wanted - below) / max(row[level], 1e-9)))
