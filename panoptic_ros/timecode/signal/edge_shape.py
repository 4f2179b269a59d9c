"""The step response of the channel, as it appears in the samples: a guess, and corrections learnt from words.

An edge of 40 us of the generator behind the low pass of a recorder is a good guess for a short line. Other
filters, tapes and clipping change it. That also changes where a word seems to begin, by an amount that
depends on its bits. So a correction of the step response (cubic B-splines) is learnt from the words, and
the droop of a coupling capacitor (the share of the integral of the samples that restores the plateaus). All
of it is linear: normal equations are summed over words, and the level, place, length and baseline of each
word are left free.

The origin of a step cannot be learnt. The correction must not move the guess as a least-squares fit of the
guess would see it, wherever it lies between samples. So learning removes the scatter and leaves the mean.

Words often last a whole number of samples. Many in a row then show a step at the same places only. What lies
between follows from the band that a recorder lets pass. Without that, words would stick to those places.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import numpy as np

from panoptic_ros.timecode.signal.baseline import Baseline, gram_without
from panoptic_ros.timecode.signal.edge_tables import kinds_of, moves_of, spline_tables, step_guess
from panoptic_ros.timecode.signal.shape_kernels import (
    OWN,
    PLACE,
    corrected,
    integrated,
    shape_rows,
    without_own,
)
from panoptic_ros.timecode.signal.wave import Edges, Samples, train_rows

Array = np.ndarray
REACH = 12  # samples at up to 48 kHz
KNOT = 0.5  # samples at up to 48 kHz
BASE_RATE = 48_000
# Prior deviations of corrections, of the level: odd ones, even ones, which come from asymmetric filters, and
# those outside of the band of a recorder, which clipping makes.
SPREADS = np.array([0.1, 0.005, 0.005])
LEAST_SPREAD = 1e-4
DROOP_SPREAD = 0.1  # per sample
MEMORY = 300.0  # words; half of them at first, since the first ones were fitted with the guess
LEAST_DROOP_HZ = 6.0  # corner of the coupling; less moves edges by less than half a microsecond
LEAST_RATE, LARGEST_RATE = 1000, 400_000  # Hz, of sound
SURE = 4.0  # standard deviations beyond which droop is believed
ALIKE_WORDS = 3.0  # words that count as one, since hum repeats
LEAST_NOISE = 0.01  # of the level: what splines cannot model


class EdgeShape:
    """The step response at a sample rate, as `table` for the kernels.

    Attributes:
        doubt: samples, standard deviation of a word's place by what is not known of the shape.
        sudden: share of the edges that jump from plateau to plateau between two samples.
        droop: per sample; 0 if there is none.
        words: that were learnt from.
    """

    LEARNT = ("_normal", "_right", "_solution", "_droops", "table", "doubt", "sudden", "droop", "words")

    def __init__(self, sample_rate: int):
        self.sample_rate = sample_rate
        scale = max(1, round(sample_rate / BASE_RATE))
        self.reach = REACH * scale
        self._knot = KNOT * scale
        self._least_droop = 2.0 * np.pi * LEAST_DROOP_HZ / sample_rate
        self._guess = step_guess(sample_rate, self.reach)
        self._splines = spline_tables(self.reach, self._knot)
        count = len(self._splines)
        self._normal = np.zeros((count + 1, count + 1))  # the last unknown is the droop
        self._right = np.zeros(count + 1)
        self._along = moves_of(sample_rate, self.reach, self._knot)
        self._solution = np.zeros(count + 1)
        self._kinds = kinds_of(count, self._knot)
        self._prior = np.zeros((count + 1, count + 1))
        self._prior[:-1, :-1] = np.tensordot(SPREADS**-2, self._kinds, axes=1)
        self._prior[-1, -1] = DROOP_SPREAD**-2
        self._droops: deque[float] = deque(maxlen=64)  # by each word alone
        self.table = self._guess
        self.doubt = 0.0
        self.sudden = 1.0
        self.droop = 0.0
        self.words = 0

    @classmethod
    def of(cls, sample_rate: int, *learnt: Any) -> EdgeShape:
        """The shape at a sample rate that has the values of `LEARNT`; all else is a function of the rate.

        Raises:
            ValueError: if no device has that rate.
        """
        if not LEAST_RATE <= sample_rate <= LARGEST_RATE:
            raise ValueError(f"a sample rate of {sample_rate} Hz")
        shape = cls(sample_rate)
        for name, value in zip(cls.LEARNT, learnt, strict=True):
            setattr(shape, name, value)
        return shape

    def straighten(self, values: Array) -> Array:
        """Samples (N,) with their droop removed; a baseline is left."""
        if self.droop == 0.0:
            return values
        return values + self.droop * integrated(values)

    def learn(
        self, clean: Samples, edges: Edges, level: float, baseline: Baseline, excess: float, sudden: float
    ) -> None:
        """Learn from a word whose fit has settled.

        Args:
            clean: samples as recorded, without clicks.
            edges: as fitted.
            level: of the word, signed.
            baseline: what is left free.
            excess: variance of the edges of the word over that of white noise.
            sudden: share of the edges that jump from plateau to plateau between two samples.
        """
        train = train_rows(clean, edges, self._guess)
        rows = shape_rows(train, level, clean.first, edges, self._splines, self._knot)
        gram, _ = gram_without(rows, baseline)
        reduced = without_own(gram)
        known = np.append(self._solution, -1.0)
        noise = (float(known @ reduced @ known) / len(clean.values) + LEAST_NOISE**2) * max(1.0, excess)
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
            sure = SURE * math.sqrt(max(0.0, float(inverse[-1, -1])))
            drooping = solution[-1] >= max(sure, self._least_droop)
        if not drooping:
            few = slice(None, -1)
            solution = np.append(_constrained(normal[few, few], self._right[few], self._along[few])[0], 0.0)
        self._solution = solution
        self.droop = float(solution[-1])
        self.table = corrected(self._guess, self._splines, solution[:-1])
        self.table.flags.writeable = False

    def _place_doubt(self, moves: Array) -> float:
        """Standard deviation, samples, of a word's place by what is not known of the shape.

        Where no edge was heard yet, the guess may be as wrong as it was found to be elsewhere.

        Args:
            moves: (J + 1,) of a word by each correction and the droop.
        """
        count, known = len(self._splines), self._solution[:-1]
        inverse = np.linalg.inv(self._normal + self._prior)[:-1, :-1]
        heard = (self._kinds * (np.eye(count) - inverse * SPREADS[:, None, None] ** -2)).sum(axis=(1, 2))
        # Projections have no negative form; at high sample rates one of them is 0 but for rounding.
        found = np.sqrt(np.maximum(known @ self._kinds @ known, 0.0) / np.maximum(heard, 1.0))
        spreads = np.clip(found, LEAST_SPREAD, SPREADS[0])
        free = slice(None, None if self.droop else -1)
        normal, along, moves = self._normal[free, free].copy(), self._along[free], moves[free]
        normal[:count, :count] += np.tensordot(spreads**-2, self._kinds, axes=1)
        inverse = np.linalg.inv(normal)
        across = inverse @ along
        variance = moves @ inverse @ moves - (moves @ across) ** 2 / (along @ across)
        return float(np.sqrt(max(0.0, variance)))

    def _drooping(self) -> bool:
        """Whether words agree that there is droop; hum sometimes looks like it."""
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
