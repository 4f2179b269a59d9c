"""Where the next word is expected, and which countings its labels may belong to."""
from __future__ import annotations

import numpy as np

from panoptic_ros.domain import FrameRate, Timecode
from panoptic_ros.timecode.fit_kernels import line_fit
from panoptic_ros.timecode.kernels import moved_grid
from panoptic_ros.timecode.labels import WORST_NATS, Solution, Verdict, judge
from panoptic_ros.timecode.rates import closest_rate
from panoptic_ros.timecode.timing import WordFit
from panoptic_ros.timecode.words import USER_BITS, WORD_CELLS, known_bits

Array = np.ndarray
LEAST_STD = 0.001  # samples; no sampler is better
BENDING = 0.05  # cells about a line: the speed changes so much that it does so within a word
FEW_WORDS, ALIKE = 6, 0.25  # from which a curve is told from scatter; correlation of neighbours on a curve
SPREAD = 5e-4  # samples squared, about a line at constant speed
LINE_WORDS = 10  # through whose middles the line goes that gives the length of a cell
MOST_TURN = 1e-4  # of the bend from word to word
SURE_NATS = 10.0  # by which other labels must be worse
RULED_OUT_NATS = 30.0  # by which a counting is so much worse that it is forgotten
CLEAN_SHARE = 0.93  # of the levels that bits explain if there is no click
USER_NATS = 15.0  # by which a word must contradict the user bits of the last ones to change them


class Follow:
    """A signal that was found.

    Args:
        grid: (3,) of the word with `number`, in raw samples.
        bending: whether its speed changes.
        line: length of a cell and its deviation if they are known from later words.
    """

    def __init__(
        self, grid: Array, number: int, reverse: bool, bending: bool, solution: Solution,
        line: tuple[float, float] | None = None,
    ):  # fmt: skip
        self.grid, self.number, self.reverse, self.bending = grid, number, reverse, bending
        self.misses = 0
        self._countings = dict(solution.countings)
        self._user = (solution.user > 0.0).astype(np.int8)
        self._middles: list[tuple[int, float, float]] = []  # word number, middle, its variance
        self._early_line = line
        self._scatter = 0.0  # samples, of the last words about a line that they lie on
        self._astray = 0.0  # cells, of the last words about a line
        self._bend = number - 2, 0.0  # word and its bend
        self._first: tuple[int, float] | None = None  # number and middle of the first word that was read

    @property
    def started(self) -> bool:
        """Whether a good word was read."""
        return self._first is not None

    def judge(self, halves: Array) -> Verdict:
        """The word's levels (160,), in the order of sending, against the most likely label."""
        verdicts = [judge(halves, bits) for bits in self._wanted().values()]
        return min(verdicts, key=lambda verdict: verdict.nats)

    def _wanted(self) -> dict[str, Array]:
        labels = [counting.label(self.number) for counting in self._countings]
        return {str(label): known_bits(label) for label in labels}

    def label(self, halves: Array, good: bool) -> tuple[Timecode, bool]:
        """The word's label and whether no other is about as likely; learns which countings are."""
        labels = {counting: counting.label(self.number) for counting in self._countings}
        if good and len(labels) > 1:
            nats = {text: judge(halves, bits).nats for text, bits in self._wanted().items()}
            for counting, label in labels.items():
                self._countings[counting] += min(nats[str(label)], WORST_NATS)
        elif len({str(label) for label in labels.values()}) > 1:
            return next(iter(labels.values())), False
        best = min(self._countings, key=lambda counting: self._countings[counting])
        least = self._countings[best]
        doubtful = any(
            str(labels[counting]) != str(labels[best])
            for counting, nats in self._countings.items() if nats < least + SURE_NATS
        )  # fmt: skip
        self._countings = {c: n - least for c, n in self._countings.items() if n < least + RULED_OUT_NATS}
        return labels[best], not doubtful

    def bits(self, halves: Array, label: Timecode, good: bool) -> Verdict:
        """The word's bits with the user bits of the last words unless a good word clearly has others."""
        wanted = known_bits(label)
        free = judge(halves, wanted)
        wanted[USER_BITS] = self._user
        same = judge(halves, wanted)
        most = USER_NATS if free.share > CLEAN_SHARE else 6.0 * USER_NATS
        if not good or same.nats < free.nats + most:
            return same
        self._user = free.bits[USER_BITS]
        return free

    def rate(self, sample_rate: int) -> FrameRate:
        """The rate of those still possible whose words are as long as the ones heard."""
        length = WORD_CELLS * self.grid[1]
        if self._first is not None and self.number > self._first[0] + 2:
            length = (self.grid[0] - self._first[1]) / (self.number - self._first[0])
        return closest_rate({counting.rate for counting in self._countings}, sample_rate / length)

    def miss(self) -> None:
        """The word could not be read; the next is expected where it would be."""
        self.misses += int(self.number >= 0)  # negative numbers: perhaps before the signal
        self._next(self.grid)

    def hit(self, fit: WordFit, good: bool) -> tuple[float, float]:
        """The word was read: the first edge of its bit 0 and the standard deviation; moves on."""
        if not good:
            self.misses += int(self.number >= 0)
            return self._passed(fit)
        self.misses = 0
        self._middles = [*self._middles, (self.number, fit.middle, fit.middle_std**2)][-LINE_WORDS:]
        if self._first is None:
            self._first = self.number, fit.middle
        side = 0.5 * WORD_CELLS * (1.0 if self.reverse else -1.0)
        line = self._line()
        if line is not None or len(self._middles) > 2:
            self.bending = line is None and self._astray > BENDING
        if line is None:
            gradient = np.array([1.0, side * (1.0 + fit.bend * side), fit.cell * side * side])
            std = float(np.sqrt(gradient @ fit.covariance @ gradient))
            edge = float(moved_grid(fit.grid, side)[0])
            if self.bending:
                self._advance(fit)
            else:
                self._next(np.array([fit.middle, fit.cell, 0.0]))
        else:
            cell, cell_std = line
            edge = fit.middle + side * cell
            std = float(np.hypot(max(fit.middle_std, self._scatter), side * cell_std))
            self._next(np.array([fit.middle, cell, 0.0]))
        return edge, float(np.hypot(std, LEAST_STD))

    def _advance(self, fit: WordFit) -> None:
        """To the next word while the speed changes; the change is taken to go on changing."""
        number, bend = self._bend
        self._bend = self.number, fit.bend
        turn = fit.bend - bend if number == self.number - 1 else 0.0
        cubic = float(np.clip(turn, -MOST_TURN, MOST_TURN)) / (3.0 * WORD_CELLS)
        u = float(WORD_CELLS)
        stretch = 1.0 + 2.0 * fit.bend * u + 3.0 * cubic * u * u
        middle = fit.middle + fit.cell * (u + fit.bend * u * u + cubic * u**3)
        self.grid = np.array([middle, fit.cell * stretch, (fit.bend + 3.0 * cubic * u) / stretch])
        self.number += 1

    def _passed(self, fit: WordFit) -> tuple[float, float]:
        """The same for a word that clicks may have shifted: nothing is learnt from it."""
        side = 0.5 * WORD_CELLS * (1.0 if self.reverse else -1.0)
        edge = float(moved_grid(np.array([fit.middle, self.grid[1], self.grid[2]]), side)[0])
        self._next(self.grid)
        return edge, float(np.hypot(fit.middle_std, 0.5 * WORD_CELLS * fit.cell_std))

    def restart(self, grid: Array, number: int, solution: Solution) -> Follow:
        """The same signal from an earlier word on, with the speed that is known by now."""
        line = self._line()
        if line is None or self.bending:
            return Follow(grid, number, self.reverse, self.bending, solution)
        last, middle, _ = self._middles[-1]
        early = np.array([middle - (last - number) * WORD_CELLS * line[0], line[0], 0.0])
        return Follow(early, number, self.reverse, False, solution, line)

    def _next(self, grid: Array) -> None:
        self.grid = moved_grid(grid, float(WORD_CELLS))
        self.number += 1

    def _line(self) -> tuple[float, float] | None:
        """Length of a cell and its deviation by the line through the last words, if they lie on one."""
        if self._early_line is not None and len(self._middles) < LINE_WORDS:
            return self._early_line
        if len(self._middles) < 3:
            return None
        slope, norm, spread, expected, alike = line_fit(*np.array(self._middles).T.copy())
        self._astray = float(np.sqrt(spread)) / slope * WORD_CELLS
        expected = max(expected, 1e-6)
        curved = len(self._middles) < FEW_WORDS or alike > ALIKE or self._astray > BENDING
        if spread > 9.0 * expected + SPREAD and curved:  # the speed changes
            return None
        self._scatter = float(np.sqrt(spread)) if len(self._middles) >= FEW_WORDS else 0.0
        return slope / WORD_CELLS, float(np.sqrt(max(spread, expected) / norm)) / WORD_CELLS
