"""How noisy 2D joints are, learnt online from residuals: by score, by being hidden, by view and by size.

Detectors place joints relative to the person: a large one has larger errors in pixels. COCO's object keypoint
similarity takes errors as proportional to the size; nets of a coarse grid have a floor of some pixels. So
noise is size ** exponent, with an exponent between 0 and 1: the slope of log residuals over log sizes.

Residuals are of well-supported joints, and their leverage is taken out (`residuals`).
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import Evidence
from panoptic_ros.kernels import njit
from panoptic_ros.solving.evidence import RigArrays

Array = np.ndarray

SCORE_BINS = 10
KINDS = 3  # of joints: visible, perhaps hidden, hidden (see `occlusion`)
LEVELS = 64  # bins of the histogram over the logarithm of residuals
LEVEL_RANGE = (0.02, 50.0)  # residual / initial sigma
LOW = float(np.log(LEVEL_RANGE[0]))
WIDTH = (float(np.log(LEVEL_RANGE[1])) - LOW) / LEVELS
RAYLEIGH_MEDIAN = 1.17741  # of a 2D residual with standard deviation 1 per axis
PRIOR_COUNT = 40.0  # weight of the initial values, in residuals
HIDDEN_PRIOR_COUNT = 5.0  # the same for joints that are hidden or may be, which are few
VIEW_PRIOR_COUNT = 200.0
GROWTH_PRIOR = 20.0  # weight of the exponent 0, in residuals times variance of their log sizes
CLIP = 4.0  # of log residuals; outliers are clipped to it
REACH = 1.4  # of log sizes from their mean, at which they are clipped
SMALLEST = 1e-4  # of a size: people of one joint have none
CARRIED_NOISE = 0.022  # of the diagonal of a 2D person, after a second of being carried by motion


class Marks(NamedTuple):
    """D 2D people of J joints: see `Evidence`.

    kinds (D, J) of the joints; cameras (D,), and for how long, s, each was carried, ages (D,).
    """

    plane: Array
    magnification: Array
    scores: Array
    kinds: Array
    cameras: Array
    ages: Array

    @classmethod
    def of(cls, evidence: Evidence, kinds: Array, ages: Array) -> Marks:
        """Those of an instant."""
        cameras = evidence.cameras[evidence.view]
        return cls(evidence.plane, evidence.magnification, evidence.scores, kinds, cameras, ages)


class Shares(NamedTuple):
    """What is learnt: histograms of residuals, scores (B, LEVELS) by kind and score, and views (C, LEVELS) by
    camera; shares (B,) of the diagonal and factors (C,) that follow from them; sums (5,) of 1, x, y, x x and
    x y with x the log of sizes, as shares of the diagonal, and y of residuals."""

    scores: Array
    views: Array
    shares: Array
    factors: Array
    sums: Array


class NoiseTable:
    """Standard deviations of 2D joints as a share of the image's diagonal.

    sigma = share[kind, score bin] * factor[camera] * growth(size). The first two are medians of residuals
    (with leverage taken out), so they adapt to calibration errors of whole views however wrong the start was,
    and outliers do not matter; the exponent of the third is by linear regression. Deterministic: a function
    of the residuals in their order.
    """

    def __init__(self, cameras: int, initial: float, memory: float):
        self._initial, self._memory = initial, memory
        scores, views = np.zeros((KINDS * SCORE_BINS, LEVELS)), np.zeros((cameras, LEVELS))
        middle = int((np.log(RAYLEIGH_MEDIAN) - LOW) / WIDTH)
        scores[:, middle], views[:, middle] = HIDDEN_PRIOR_COUNT, VIEW_PRIOR_COUNT
        scores[:SCORE_BINS, middle] = PRIOR_COUNT
        shares, factors = np.full(len(scores), initial), np.ones(cameras)
        self._learnt = Shares(scores, views, shares, factors, np.zeros(5))
        self.learnt = False  # whether any residual was used

    @property
    def exponent(self) -> float:
        """0 = noise does not depend on the size of people, 1 = it is proportional."""
        return float(growth_of(self._learnt.sums)[1])

    def precisions(self, marks: Marks, rig: RigArrays) -> Array:
        """1 / standard deviation (D, J) on the normalised plane of 2D joints, 0 = missing.

        People who were carried have gone astray by a random walk besides.
        """
        precisions: Array = look_up(marks, self._learnt, rig.focals, rig.diagonals)
        return precisions

    def learn(self, marks: Marks, residuals: tuple[Array, Array, Array], rig: RigArrays) -> None:
        """Update with residuals: rows (N,) and joints (N,) of the marks, and px (N,) without leverage.

        People who were carried teach nothing.
        """
        start, sizes = (self._initial, self._memory), (rig.focals, rig.diagonals)
        self.learnt |= count_residuals(marks, residuals, self._learnt, sizes, start)


@njit(cache=True, error_model="numpy")
def look_up(marks, learnt, focals, diagonals):
    """The loops of `NoiseTable.precisions`; focals, diagonals: (C,) px."""
    result, growth = np.zeros(marks.scores.shape), growth_of(learnt.sums)
    for d in range(len(result)):
        camera = marks.cameras[d]
        size = _size(marks, d) * focals[camera]
        scale = learnt.factors[camera] * diagonals[camera] * _grown(size / diagonals[camera], growth)
        astray = CARRIED_NOISE * np.sqrt(marks.ages[d]) * size
        for j in range(result.shape[1]):
            if marks.scores[d, j] > 0.0:
                sigma = np.hypot(learnt.shares[_bin(marks, d, j)] * scale, astray)
                result[d, j] = focals[camera] * marks.magnification[d, j] / sigma
    return result


@njit(cache=True, error_model="numpy")
def _bin(marks, d, j):
    """The bin of a 2D joint, by kind and score."""
    return SCORE_BINS * marks.kinds[d, j] + min(int(marks.scores[d, j] * SCORE_BINS), SCORE_BINS - 1)


@njit(cache=True, error_model="numpy")
def _size(marks, d):
    """Diagonal of the box of a 2D person on the plane, as large as it is in the image."""
    left = top = np.inf
    right = bottom = -np.inf
    zoom, count = 0.0, 0
    for j in range(marks.scores.shape[1]):
        if marks.scores[d, j] > 0.0:
            left, right = min(left, marks.plane[d, j, 0]), max(right, marks.plane[d, j, 0])
            top, bottom = min(top, marks.plane[d, j, 1]), max(bottom, marks.plane[d, j, 1])
            zoom, count = zoom + marks.magnification[d, j], count + 1
    return np.hypot(right - left, bottom - top) * zoom / count if count else 0.0


@njit(cache=True, error_model="numpy")
def growth_of(sums):
    """Mean log size, at which noise is as stated, and the exponent by which it grows with the size."""
    if sums[0] == 0.0:
        return 0.0, 0.0
    count, x, y, xx, xy = sums
    slope = (xy - x * y / count) / (xx - x * x / count + GROWTH_PRIOR)
    return x / count, min(max(slope, 0.0), 1.0)


@njit(cache=True, error_model="numpy")
def _grown(size, growth):
    """Noise of somebody of this size, relative to that of the mean size."""
    middle, exponent = growth
    return np.exp(exponent * min(REACH, max(-REACH, np.log(max(size, SMALLEST)) - middle)))


@njit(cache=True, error_model="numpy")
def count_residuals(marks, residuals, learnt, rig, start):
    """The loops of `NoiseTable.learn`, in place; whether there were any.

    Args:
        rig: focals and diagonals (C,) px. start: initial share and memory.
    """
    (rows, joints, pixels), (focals, diagonals), (initial, memory) = residuals, rig, start
    sizes, shares, used = np.empty(len(rows)), np.full(len(rows), np.nan), 0
    for i in range(len(rows)):
        d, camera = rows[i], marks.cameras[rows[i]]
        if marks.ages[d] > 0.0:
            continue
        used += 1
        shares[i] = pixels[i] * marks.magnification[d, joints[i]] / diagonals[camera] / learnt.factors[camera]
        sizes[i] = _size(marks, d) * focals[camera] / diagonals[camera]
        _add_logs(learnt.sums, sizes[i], shares[i] / learnt.shares[_bin(marks, d, joints[i])])
    if used == 0:
        return False
    learnt.sums[:] *= min(1.0, memory / learnt.sums[0])
    growth = growth_of(learnt.sums)
    for i in range(len(rows)):
        if np.isfinite(shares[i]):
            shares[i] /= _grown(sizes[i], growth)
            learnt.scores[_bin(marks, rows[i], joints[i]), _level(shares[i] / initial)] += 1.0
            shares[i] *= learnt.factors[marks.cameras[rows[i]]]
    _forget_and_halve(learnt.scores, memory, learnt.shares)
    for k in range(len(learnt.shares)):
        learnt.shares[k] *= initial
    for i in range(len(rows)):
        if np.isfinite(shares[i]):
            level = _level(shares[i] / learnt.shares[_bin(marks, rows[i], joints[i])])
            learnt.views[marks.cameras[rows[i]], level] += 1.0
    _forget_and_halve(learnt.views, memory, learnt.factors)
    return True


@njit(cache=True, error_model="numpy")
def _add_logs(sums, size, ratio):
    """Add a residual, in units of the noise at the mean size, of somebody of this size, in place."""
    x = np.log(max(size, SMALLEST))
    y = min(CLIP, max(-CLIP, np.log(max(ratio, 1e-9))))
    sums[0] += 1.0
    sums[1] += x
    sums[2] += y
    sums[3] += x * x
    sums[4] += x * y


@njit(cache=True, error_model="numpy")
def _level(ratio):
    """The level of a residual in units of sigma."""
    level = (np.log(max(ratio, 1e-9)) - LOW) / WIDTH
    return int(min(max(level, 0.0), LEVELS - 1.0))


@njit(cache=True, error_model="numpy")
def _forget_and_halve(table, memory, result):
    """Scale rows of a histogram (R, L) down to `memory` entries, in place; sigma (R,) of each, in place.

    It is by the median of each row, interpolated inside of its level.
    """
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
        middle = level + (half - below) / max(table[i, level], 1e-9)
        result[i] = np.exp(LOW + WIDTH * middle) / RAYLEIGH_MEDIAN
