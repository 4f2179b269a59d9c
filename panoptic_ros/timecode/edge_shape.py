"""What a step of the signal looks like in the samples: a guess, and what the words teach.

A generator's edge of 40 us behind a recorder's low pass is a good guess on a short line. Other filters,
tapes and clipping change it, and with it where a word seems to begin, by an amount that depends on its bits.
So the words themselves teach a correction (cubic B-splines) and the droop of a coupling capacitor
(the part of the integral of the samples that gives the plateaus back). All are linear: normal equations are
summed up over words, each with its own level, place, length and baseline left free.

Where the origin of a step is, cannot be learnt. The correction must not move the guess, as a least-squares
fit of the guess would see it, wherever it lies between samples: so learning takes the scatter away, and
leaves the mean.

Words often last a whole number of samples, so that many in a row show a step at the same places only. What
lies between follows from the band that a recorder lets pass. Without that, words would stick to those places.
"""
from __future__ import annotations

import math
from collections import deque
from functools import lru_cache

import numpy as np
from scipy.interpolate import BSpline

from panoptic_ros.timecode.baseline import Baseline
from panoptic_ros.timecode.fit_kernels import gram_without, train_rows
from panoptic_ros.timecode.shape_kernels import OWN, PLACE, corrected, integrated, shape_rows, without_own

Array = np.ndarray
PHASES = 32  # places between two samples
REACH = 12  # samples at up to 48 kHz
KNOT = 0.5  # samples at up to 48 kHz
BASE_RATE = 48_000
EDGE_SECONDS = 15.6e-6  # standard deviation of an edge of 40 us rise time
BAND = 0.465  # cycles per sample that a recorder lets pass
# What corrections may be beforehand, of the level: odd ones, even ones, which come from lopsided filters,
# and those that a recorder's low pass cannot make, but clipping can.
SPREADS = np.array([0.1, 0.005, 0.005])
LEAST_SPREAD = 1e-4
DROOP_SPREAD = 0.1  # per sample
MEMORY = 300.0  # words; half of them at first, since the first ones were fitted with the guess
LEAST_DROOP_HZ = 6.0  # corner of the coupling; less moves edges by less than half a microsecond
SURE = 4.0  # standard deviations from which on droop is believed
ALIKE_WORDS = 3.0  # that count as one, since hum repeats
LEAST_NOISE = 0.01  # of the level: what splines cannot say


class EdgeShape:
    """The shape of a step at a sample rate, as `table` for the kernels."""

    def __init__(self, sample_rate: int):
        scale = max(1, round(sample_rate / BASE_RATE))
        self.reach = REACH * scale
        self._knot = KNOT * scale
        self._least_droop = 2.0 * np.pi * LEAST_DROOP_HZ / sample_rate
        self._guess, self._splines = _guess(sample_rate, self.reach), _splines(self.reach, self._knot)
        count = len(self._splines)
        self._normal = np.zeros((count + 1, count + 1))  # the last unknown is the droop
        self._right = np.zeros(count + 1)
        self._along = _along(sample_rate, self.reach, self._knot)
        self._solution = np.zeros(count + 1)
        self._kinds = _kinds(count, self._knot)
        self._prior = np.zeros((count + 1, count + 1))
        self._prior[:-1, :-1] = np.tensordot(SPREADS**-2, self._kinds, axes=1)
        self._prior[-1, -1] = DROOP_SPREAD**-2
        self._droops: deque[float] = deque(maxlen=64)  # by each word alone
        self.table = self._guess
        self.doubt = 0.0
        self.sudden = 1.0
        self.droop = 0.0
        self.words = 0

    def straighten(self, values: Array) -> Array:
        """Samples (N,) without droop; a baseline is left."""
        if self.droop == 0.0:
            return values
        return values + self.droop * integrated(values)

    def learn(
        self, values: Array, low: int, grid: Array, places: Array, level: float, slow: Baseline,
        excess: float, sudden: float,
    ) -> None:  # fmt: skip
        """From a word whose fit has settled.

        Args:
            values: (N,) samples as recorded, without clicks.
            low: index of the first.
            grid, places: see `train_rows`.
            level: of the word, signed.
            slow: what is left free.
            excess: variance of the word's edges over that from white noise.
            sudden: share of the edges that jump from plateau to plateau between two samples.
        """
        train = train_rows(low, values, grid, places, self._guess, 4)
        rows = shape_rows(train, level, low, grid, places, self._splines, self._knot)
        gram, _ = gram_without(rows, slow.basis, slow.step)
        reduced = without_own(gram)
        known = np.append(self._solution, -1.0)
        noise = (float(known @ reduced @ known) / len(values) + LEAST_NOISE**2) * max(1.0, excess)
        keep = 1.0 - 1.0 / min(MEMORY, 0.5 * self.words + 4.0)
        alone = np.linalg.solve(reduced[:-1, :-1] / noise + self._prior, reduced[:-1, -1] / noise)
        self._droops.append(float(alone[-1]))
        self._normal = keep * self._normal + reduced[:-1, :-1] / noise
        self._right = keep * self._right + reduced[:-1, -1] / noise
        self.sudden += (sudden - self.sudden) / min(self.words + 1.0, MEMORY)
        self.words += 1
        self._solve()
        moves = np.linalg.solve(gram[:OWN, :OWN], gram[:OWN, OWN:-1])[PLACE]
        self.doubt = self._place_doubt(moves)

    def _solve(self) -> None:
        """The correction and the droop, if there is one."""
        normal = self._normal + self._prior
        drooping = self._drooping()
        if drooping:
            solution, inverse = _constrained(normal, self._right, self._along)
            drooping = solution[-1] >= max(SURE * np.sqrt(inverse[-1, -1]), self._least_droop)
        if not drooping:
            few = slice(None, -1)
            solution = np.append(_constrained(normal[few, few], self._right[few], self._along[few])[0], 0.0)
        self._solution = solution
        self.droop = float(solution[-1])
        self.table = corrected(self._guess, self._splines, solution[:-1])
        self.table.flags.writeable = False

    def _place_doubt(self, moves: Array) -> float:
        """Standard deviation, samples, by which what is not known of the shape may move a word.

        Where no edge was heard yet, the guess may be as wrong as it was found elsewhere.

        Args:
            moves: (J + 1,) of a word by each correction and the droop.
        """
        count, known = len(self._splines), self._solution[:-1]
        inverse = np.linalg.inv(self._normal + self._prior)[:-1, :-1]
        heard = (self._kinds * (np.eye(count) - inverse * SPREADS[:, None, None] ** -2)).sum(axis=(1, 2))
        found = np.sqrt(known @ self._kinds @ known / np.maximum(heard, 1.0))
        spreads = np.clip(found, LEAST_SPREAD, SPREADS[0])
        free = slice(None, None if self.droop else -1)
        normal, along, moves = self._normal[free, free].copy(), self._along[free], moves[free]
        normal[:count, :count] += np.tensordot(spreads**-2, self._kinds, axes=1)
        inverse = np.linalg.inv(normal)
        across = inverse @ along
        variance = moves @ inverse @ moves - (moves @ across) ** 2 / (along @ across)
        return float(np.sqrt(max(0.0, variance)))

    def _drooping(self) -> bool:
        """Whether words agree that there is droop; hum looks like it now and then."""
        words = len(self._droops)
        count = words / ALIKE_WORDS
        mean = sum(self._droops) / words
        scatter = math.sqrt(sum((droop - mean) ** 2 for droop in self._droops) / words)
        return count >= 1.0 and mean > SURE * max(scatter, self._least_droop) / math.sqrt(count)


def _constrained(normal: Array, right: Array, along: Array) -> tuple[Array, Array]:
    """Least squares with along @ x = 0, and the inverse of the normal matrix."""
    inverse = np.linalg.inv(normal)
    solution = inverse @ right
    across = inverse @ along
    size = float(along @ across)
    if size > 0.0:
        solution = solution - across * (float(along @ solution) / size)
    return solution, inverse


def _kinds(count: int, knot: float) -> Array:
    """Projections (3, J, J) on odd and even corrections and on what lies beyond the band."""
    one, flip = np.eye(count), np.eye(count)[::-1]
    band = min(1.0, 2.0 * BAND * knot)
    apart = np.arange(count)[:, None] - np.arange(count)
    return np.stack([0.5 * (one - flip), 0.5 * (one + flip), one - band * np.sinc(band * apart)])


def _places(reach: int) -> Array:
    """Distances from an edge, (P + 1, 2 R), samples."""
    return np.arange(-reach, reach) + np.arange(PHASES + 1)[:, None] / PHASES


def _slope(table: Array) -> Array:
    """Derivative of a continuous table (P + 1, 2 R)."""
    line = np.append(table[:-1].T.ravel(), table[-1, -1])
    slope = np.gradient(line, 1.0 / PHASES)
    inner = slope[:-1].reshape(-1, PHASES).T
    return np.vstack([inner, np.append(inner[0, 1:], slope[-1])])


@lru_cache(maxsize=8)
def _guess(sample_rate: int, reach: int) -> Array:
    """(2, P + 1, 2 R): a Gaussian edge behind a low pass, less its sign; its slope."""
    sigma = EDGE_SECONDS * sample_rate * PHASES
    half = 4 * reach * PHASES
    at = np.arange(-half, half + 1) / PHASES
    low_pass = np.sinc(2.0 * BAND * at) * np.kaiser(len(at), 8.0)
    near = np.arange(-int(6.0 * sigma) - 1, int(6.0 * sigma) + 2)
    density = np.convolve(low_pass, np.exp(-0.5 * (near / sigma) ** 2), mode="same")
    level = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
    density, level = 2.0 * density * PHASES / level[-1], 2.0 * level / level[-1] - 1.0
    places = _places(reach)
    sign = np.where(np.arange(2 * reach) >= reach, 1.0, -1.0)
    table = np.stack([np.interp(places, at, level) - sign, np.interp(places, at, density)])
    table.flags.writeable = False
    return table


@lru_cache(maxsize=8)
def _along(sample_rate: int, reach: int, knot: float) -> Array:
    """How far each correction and the droop would move the guess, to scale (J + 1,)."""
    slope = _guess(sample_rate, reach)[1]
    return np.append((_splines(reach, knot)[:, 0] * slope).sum(axis=(1, 2)), 0.0)


@lru_cache(maxsize=8)
def _splines(reach: int, knot: float) -> Array:
    """(J, 2, P + 1, 2 R): cubic B-splines inside of the reach and their slopes."""
    places = _places(reach)
    knots = np.arange(-reach, reach + 0.5 * knot, knot)
    out = []
    for first in range(len(knots) - 4):
        spline = BSpline.basis_element(knots[first : first + 5], extrapolate=False)
        value = np.nan_to_num(spline(places))
        out.append(np.stack([value, _slope(value)]))
    table = np.array(out)
    table.flags.writeable = False
    return table
