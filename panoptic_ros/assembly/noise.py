"""Noise of 2D joints, learnt online from residuals: by score, occlusion, view and size of the person.

The residuals are those of well-supported joints, corrected for leverage (`residuals`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import Evidence
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.kernels import njit

Array = np.ndarray

SCORE_BINS = 10
KINDS = 3  # occlusion of joints: 0 visible, 1 perhaps hidden, 2 hidden (see `occlusion`)
LEVELS = 64  # bins of histograms over the logarithm of residuals
LEVEL_RANGE = (0.02, 50.0)  # residual / initial sigma, range of the histograms
LOW = float(np.log(LEVEL_RANGE[0]))
WIDTH = (float(np.log(LEVEL_RANGE[1])) - LOW) / LEVELS
RAYLEIGH_MEDIAN = 1.17741  # median length of a 2D residual with standard deviation 1 per axis
# quantile that measures the tail; this quantile of the length of a 2D residual with standard deviation 1 per
# axis
MOST_OF, RAYLEIGH_MOST = 0.9, 2.14597
PRIOR_COUNT = 20.0  # weight of the initial values of visible joints, in residuals
# weight of the initial values of hidden and perhaps hidden joints, in residuals; these joints are few
HIDDEN_PRIOR_COUNT = 2.5
VIEW_PRIOR_COUNT = 100.0  # weight of the initial factor of a camera, in residuals
SIZE_PRIOR = 10.0  # weight of the prior slope 0, in residuals times variance of their log sizes
REACH, CLIP = 1.4, 4.0  # limits of log sizes about their mean, and of log residuals
CARRIED_NOISE = 0.022  # share of a 2D pose's size, noise after 1 s of propagation by optical flow


class NoiseCovariates(NamedTuple):
    """D 2D poses with J joints, and all values on which their noise depends; see `Evidence`.

    Args:
        plane: (D, J, 2) undistorted normalised points.
        magnification: (D, J) image scale at the points.
        scores: (D, J), 0 where missing.
        kinds: (D, J) occlusion of the joints, see `KINDS`.
        cameras: (D,) index into the rig.
        sizes: (D,) diagonals of the bounding boxes on the plane at 1 m, times the mean magnification.
        ages: (D,) s, time for which optical flow propagated each 2D pose.
    """

    plane: Array
    magnification: Array
    scores: Array
    kinds: Array
    cameras: Array
    sizes: Array
    ages: Array

    @classmethod
    def of(cls, evidence: Evidence, kinds: Array, ages: Array) -> NoiseCovariates:
        """Return the record of one instant."""
        shown = evidence.plane, evidence.magnification, evidence.scores
        return cls(*shown, kinds, evidence.cameras[evidence.view], sizes_of(*shown), ages)


class NoiseStatistics(NamedTuple):
    """Learnt values: B bins by occlusion and score, C cameras.

    Args:
        scores: (B, LEVELS) histograms of residuals by bin.
        views: (C, LEVELS) histograms of residuals by camera.
        shares: (B,) standard deviations as shares of the image diagonal.
        factors: (C,) factors on these.
        tails: (B,) factors on these where few views show a joint.
        sums: (5,) sums of 1, x, y, x^2, x y for log sizes x and log residuals y.
        growth: (2,) mean of x, and slope of y over x.
    """

    scores: Array
    views: Array
    shares: Array
    factors: Array
    tails: Array
    sums: Array
    growth: Array


class NoiseTable:
    """Standard deviations of 2D joints as shares of the image diagonal.

    sigma = share[kind, score bin] * factor[camera] * size ** slope. Shares and factors are medians of
    residuals, corrected for leverage. So they adapt to calibration errors of whole views, however wrong the
    start was, and outliers do not matter. The error of a network may grow with the size of the person (slope
    1, as in COCO's object keypoint similarity), or follow its grid (slope 0). The table is deterministic: a
    function of the residuals in their order.

    If many views show a joint, wrong views are identified as outliers. If only one or two views show it,
    wrong views are not identified, and all residuals count. The tail describes these: the 90 % quantile of
    the residuals relative to their median.
    """

    def __init__(self, cameras: int, initial: float, memory: float):
        self._initial, self._memory = initial, memory
        scores, views = np.zeros((KINDS * SCORE_BINS, LEVELS)), np.zeros((cameras, LEVELS))
        middle = int((np.log(RAYLEIGH_MEDIAN) - LOW) / WIDTH)
        scores[:, middle], views[:, middle] = HIDDEN_PRIOR_COUNT, VIEW_PRIOR_COUNT
        scores[:SCORE_BINS, middle] = PRIOR_COUNT
        shares, tails = np.full(len(scores), initial), np.ones(len(scores))
        self._learnt = NoiseStatistics(
            scores, views, shares, np.ones(cameras), tails, np.zeros(5), np.zeros(2)
        )
        self.learnt = False  # whether any residual was used

    def precisions(self, marks: NoiseCovariates, rig: RigArrays) -> Array:
        """Return 1 / standard deviation (D, J) of 2D joints on the normalised plane, 0 = missing.

        2D poses that optical flow propagated have the noise of a random walk in addition.
        """
        precisions: Array = look_up(marks, self._learnt, rig.focals, rig.diagonals)
        return precisions

    def tails(self, marks: NoiseCovariates) -> Array:
        """Return the factors (D, J) on standard deviations of joints that few views show."""
        tails: Array = tails_of(marks, self._learnt.tails)
        return tails

    def learn(self, marks: NoiseCovariates, residuals: tuple[Array, Array, Array], rig: RigArrays) -> None:
        """Update the table with residuals of 2D joints; propagated 2D poses are ignored.

        Args:
            residuals: Rows (N,) and joints (N,) of the marks, and residuals (N,) px corrected for leverage.
        """
        start = self._initial, self._memory
        self.learnt |= count_residuals(marks, residuals, self._learnt, rig.focals, rig.diagonals, start)


@njit(cache=True, error_model="numpy")
def look_up(marks, learnt, focals, diagonals):
    """Return 1 / standard deviation (D, J) of 2D joints on the normalised plane, 0 = missing.

    Args:
        focals, diagonals: (C,) px.
    """
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
    """Return the factors (D, J) on standard deviations of joints that few views show."""
    result = np.ones(marks.scores.shape)
    for d, j in np.ndindex(marks.scores.shape):
        if marks.scores[d, j] > 0.0:
            result[d, j] = tails[_bin(marks, d, j)]
    return result


@njit(cache=True, error_model="numpy")
def _bin(marks, d, j):
    """Return the bin of a 2D joint, by occlusion and score."""
    return SCORE_BINS * marks.kinds[d, j] + min(int(marks.scores[d, j] * SCORE_BINS), SCORE_BINS - 1)


@njit(cache=True, error_model="numpy")
def _growth(learnt, size):
    """Return the noise of a 2D pose relative to that of the mean size.

    Args:
        size: Size of the 2D pose, as a share of the image diagonal.
    """
    middle, slope = learnt.growth
    away = np.log(size) - middle if size > 0.0 else 0.0  # 2D poses of one joint have size 0
    return np.exp(slope * min(REACH, max(-REACH, away)))


@njit(cache=True, error_model="numpy")
def sizes_of(plane, magnification, scores):
    """Return the sizes (D,) of 2D poses, see `NoiseCovariates`."""
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
    """Update the values in `learnt` as in `NoiseTable.learn`, and return whether there were residuals.

    Args:
        focals, diagonals: (C,) px.
        start: Initial share and memory.
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
    """Add a log size x and a log residual y to the regression sums `sums`."""
    y = min(CLIP, max(-CLIP, y))
    sums[0] += 1.0
    sums[1] += x
    sums[2] += y
    sums[3] += x * x
    sums[4] += x * y


@njit(cache=True, error_model="numpy")
def _solve_growth(learnt, memory):
    """Write the mean log size, and the slope of log residuals over log sizes, to `learnt.growth`."""
    learnt.sums[:] *= min(1.0, memory / max(learnt.sums[0], 1.0))
    count, x, y, xx, xy = learnt.sums
    middle = x / max(count, 1.0)
    slope = (xy - middle * y) / (xx - middle * x + SIZE_PRIOR)
    learnt.growth[0], learnt.growth[1] = middle, min(max(slope, 0.0), 1.0)


@njit(cache=True, error_model="numpy")
def _level(ratio):
    """Return the level (bin of the histogram) of a residual in units of sigma."""
    level = (np.log(max(ratio, 1e-9)) - LOW) / WIDTH
    return int(min(max(level, 0.0), LEVELS - 1.0))


@njit(cache=True, error_model="numpy")
def _forget(table, memory):
    """Scale the rows of the histogram `table` (R, L) down to `memory` entries each."""
    for i in range(len(table)):
        total = 0.0
        for k in range(table.shape[1]):
            total += table[i, k]
        kept = min(1.0, memory / total)
        for k in range(table.shape[1]):
            table[i, k] *= kept


@njit(cache=True, error_model="numpy")
def _quantile(row, share):
    """Return the residual at this quantile of a histogram (L,), interpolated within its level."""
    total = 0.0
    for k in range(len(row)):
        total += row[k]
    wanted, below, level = share * total, 0.0, 0
    while level < len(row) - 1 and below + row[level] < wanted:
        below += row[level]
        level += 1
    return np.exp(LOW + WIDTH * (level + (wanted - below) / max(row[level], 1e-9)))
