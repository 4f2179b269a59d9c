"""How noisy 2D joints are, learnt online from residuals: by score, by being hidden, and by view.

Residuals are of well-supported joints, and their leverage is taken out (`residuals_to_learn`).
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.domain import Evidence
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.geometry.symmetric import invert_symmetric
from panoptic_ros.kernels import njit
from panoptic_ros.solving.scene import seen_at

Array = np.ndarray

SCORE_BINS = 10
KINDS = 3  # of joints: visible, perhaps hidden, hidden (see `occlusion`)
LEVELS = 64  # bins of the histogram over the logarithm of residuals
LEVEL_RANGE = (0.02, 50.0)  # residual / initial sigma
LOW = float(np.log(LEVEL_RANGE[0]))
WIDTH = (float(np.log(LEVEL_RANGE[1])) - LOW) / LEVELS
RAYLEIGH_MEDIAN = 1.17741  # of a 2D residual with standard deviation 1 per axis
MOST_OF, RAYLEIGH_MOST = 0.9, 2.14597  # a quantile, and that of such a residual
PRIOR_COUNT = 40.0  # weight of the initial values, in residuals
HIDDEN_PRIOR_COUNT = 5.0  # the same for joints that are hidden or may be, which are few
VIEW_PRIOR_COUNT = 200.0
CARRIED_NOISE = 0.022  # of the diagonal of a 2D person, after a second of being carried by motion
MOST = 1000  # residuals per instant, about
THINNING = 1e7  # the digits of an observation that say whether it is taken
LEVERAGE = 0.7  # residuals of observations that decide alone say nothing
TWO_VIEW_LEVERAGE = 0.9
TWO_VIEW_FACTOR = 1.2345  # two views leave one residual: |N(0, 1)| has another median than a 2D length


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
    camera; shares (B,) of the diagonal, factors (C,) and tails (B,) that follow from them."""

    scores: Array
    views: Array
    shares: Array
    factors: Array
    tails: Array


class NoiseTable:
    """Standard deviations of 2D joints as a share of the image's diagonal.

    sigma = share[kind, score bin] * factor[camera]. Both are medians of residuals (with leverage taken out),
    so they adapt to calibration errors of whole views however wrong the start was, and outliers do not
    matter. Deterministic: a function of the residuals in their order.

    Of many views those that err are found out. Of two or one they are not, and all of the residuals count:
    their tail, the deviation that nine of ten show over that of half of them.
    """

    def __init__(self, cameras: int, initial: float, memory: float):
        self._initial, self._memory = initial, memory
        scores, views = np.zeros((KINDS * SCORE_BINS, LEVELS)), np.zeros((cameras, LEVELS))
        middle = int((np.log(RAYLEIGH_MEDIAN) - LOW) / WIDTH)
        scores[:, middle], views[:, middle] = HIDDEN_PRIOR_COUNT, VIEW_PRIOR_COUNT
        scores[:SCORE_BINS, middle] = PRIOR_COUNT
        shares, tails = np.full(len(scores), initial), np.ones(len(scores))
        self._learnt = Shares(scores, views, shares, np.ones(cameras), tails)
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
        self.learnt |= count_residuals(marks, residuals, self._learnt, rig.diagonals, start)


@njit(cache=True, error_model="numpy")
def look_up(marks, learnt, focals, diagonals):
    """The loops of `NoiseTable.precisions`; focals, diagonals: (C,) px."""
    result = np.zeros(marks.scores.shape)
    for d in range(len(result)):
        camera = marks.cameras[d]
        scale, astray = learnt.factors[camera] * diagonals[camera], 0.0
        if marks.ages[d] > 0.0:
            astray = CARRIED_NOISE * np.sqrt(marks.ages[d]) * _size(marks, d) * focals[camera]
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
def count_residuals(marks, residuals, learnt, diagonals, start):
    """The loops of `NoiseTable.learn`, in place; whether there were any.

    Args:
        diagonals: (C,) px. start: initial share and memory.
    """
    (rows, joints, pixels), (initial, memory) = residuals, start
    shares, used = np.full(len(rows), np.nan), 0
    for i in range(len(rows)):
        d, camera = rows[i], marks.cameras[rows[i]]
        if marks.ages[d] > 0.0:
            continue
        used += 1
        shares[i] = pixels[i] * marks.magnification[d, joints[i]] / diagonals[camera]
        level = _level(shares[i] / learnt.factors[camera] / initial)
        learnt.scores[_bin(marks, d, joints[i]), level] += 1.0
    if used == 0:
        return False
    _forget(learnt.scores, memory)
    for k in range(len(learnt.shares)):
        half = _quantile(learnt.scores[k], 0.5) / RAYLEIGH_MEDIAN
        learnt.tails[k] = max(1.0, _quantile(learnt.scores[k], MOST_OF) / RAYLEIGH_MOST / half)
        learnt.shares[k] = half * initial
    for i in range(len(rows)):
        if np.isfinite(shares[i]):
            level = _level(shares[i] / learnt.shares[_bin(marks, rows[i], joints[i])])
            learnt.views[marks.cameras[rows[i]], level] += 1.0
    _forget(learnt.views, memory)
    for k in range(len(learnt.factors)):
        learnt.factors[k] = _quantile(learnt.views[k], 0.5) / RAYLEIGH_MEDIAN
    return True


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
    plane, (joints, views) = seen.plane, residuals.shape[1:]
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
                error, leverage = _residual(positions[p, j], shifts[p, j], spread, seen, v, d, s)
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
def _residual(x, shift, spread, seen, v, d, s):
    """Distance on the plane between a joint and its observation, and the leverage of that observation.

    x: (3,) m; shift: (3,) m/s; spread: (3, 3) m^2, inverse of the normal matrix of the joint.
    """
    u, w, depth = seen_at(seen.cams, v, x, shift)
    r, row, total = seen.cams.rotations[v], np.empty(3), 0.0  # trace of J N^-1 J^T
    for i in range(2):
        for k in range(3):
            row[k] = r[i, k] - (u if i == 0 else w) * r[2, k]
        for k in range(3):
            for m in range(3):
                total += row[k] * spread[k, m] * row[m]
    error = np.sqrt((seen.plane[d, s, 0] - u) ** 2 + (seen.plane[d, s, 1] - w) ** 2)
    return error, 0.5 * total * (seen.precision[d, s] / depth) ** 2
