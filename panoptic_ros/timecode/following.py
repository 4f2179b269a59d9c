"""A signal that is followed word by word: where the next is expected, and which labels it may have."""
from __future__ import annotations

import numpy as np

from panoptic_ros.domain import FrameRate, Timecode
from panoptic_ros.timecode.edge_shape import EdgeShape
from panoptic_ros.timecode.kernels import LEAST_NOISE, moved_grid, soft_bits
from panoptic_ros.timecode.labels import WORST_NATS, Counting, Solution, Verdict, free_score, judge
from panoptic_ros.timecode.levels import WordLevels
from panoptic_ros.timecode.pace import Pace
from panoptic_ros.timecode.rates import closest_rate, possible_rates
from panoptic_ros.timecode.timing import WordFit
from panoptic_ros.timecode.user_bits import OTHER_NATS, UserBits
from panoptic_ros.timecode.words import USER_BITS, WORD_CELLS, known_bits

Array = np.ndarray
SURE_NATS = 10.0  # by which other labels must be worse
RULED_OUT_NATS = 30.0  # by which a counting is so much worse that it is forgotten
CLEAN_SHARE = 0.93  # of the levels that bits explain if there is no click
LEARN_ALL, LEARN_MANY = 16, 50  # words; then every third, then every
RARELY = 30
Digits = tuple[int, int, int, int, bool]


class Follow:
    """A signal that was found.

    Args:
        grid: (3,) of the word with `number`, in raw samples.
        solution: of the words that it was found by.
        shape: of a step, if known.
    """

    def __init__(
        self, grid: Array, number: int, reverse: bool, solution: Solution, pace: Pace, shape: EdgeShape,
        user: UserBits | None = None,
    ):  # fmt: skip
        self.grid, self.number, self.reverse = grid, number, reverse
        self.shape = shape
        self.misses = 0
        self._pace = pace
        self._keep(list(solution.countings))
        self.user = UserBits(solution.user) if user is None else user
        self._first: tuple[int, float] | None = None  # number and middle of the first word that was read
        self._free = 0.0  # score of the word's best path without a label
        self._labels: list[tuple[Digits, Timecode]] = []  # of the word, one for each counting
        self._wanted: dict[Digits, Array] = {}
        self._verdicts: dict[Digits, Verdict] = {}

    @property
    def started(self) -> bool:
        """Whether a good word was read."""
        return self._first is not None

    @property
    def bending(self) -> bool:
        """Whether the speed changes within words."""
        return self._pace.bending

    @property
    def straight(self) -> bool:
        """Whether the words so far lie on a line."""
        return self._pace.straight

    def judge(self, levels: WordLevels) -> Verdict:
        """The word against the most likely label."""
        labels = [counting.label(self.number) for counting, _ in self._countings]
        self._labels = [(_digits(label), label) for label in labels]
        self._wanted = {text: known_bits(label) for text, label in dict(self._labels).items()}
        self._free = free_score(levels)
        self._verdicts = {text: judge(levels, bits, self._free) for text, bits in self._wanted.items()}
        return min(self._verdicts.values(), key=lambda verdict: verdict.nats)

    def label(self, good: bool) -> tuple[Timecode, bool]:
        """The label of the word that was judged last, and whether no other is about as likely.

        Learns which countings are likely.
        """
        labels = self._labels
        if len(labels) == 1:
            return labels[0][1], True
        texts = [text for text, _ in labels]
        heard = self._countings
        if good and len(self._wanted) > 1:
            nats = {text: min(verdict.nats, WORST_NATS) for text, verdict in self._verdicts.items()}
            heard = [(counting, n + nats[text]) for (counting, n), text in zip(heard, texts)]
        elif len(self._wanted) > 1:
            return labels[0][1], False
        least = min(n for _, n in heard)
        best = next(k for k, (_, n) in enumerate(heard) if n == least)
        doubtful = any(text != texts[best] for (_, n), text in zip(heard, texts) if n < least + SURE_NATS)
        self._keep([(c, n - least) for c, n in heard if n < least + RULED_OUT_NATS])
        return labels[best][1], not doubtful

    def bits(self, levels: WordLevels, label: Timecode, good: bool) -> Verdict:
        """The bits of the word judged last, user bits as those of others unless it clearly has its own."""
        text = _digits(label)
        wanted = self._wanted[text].copy()
        wanted[USER_BITS] = self.user.likely
        same = judge(levels, wanted, self._free)
        free = self._verdicts[text]
        if not good or (self.user.certain and same.nats - free.nats < OTHER_NATS):
            return same
        halves, level = levels.halves, free.level
        square = float(halves @ halves) / len(halves)
        noise = max(square - level * level, (LEAST_NOISE * level) ** 2)
        soft = soft_bits(halves, self._wanted[text], levels.before)[USER_BITS] * (level / noise)
        self.user.hear(soft, same.nats - free.nats, free.share > CLEAN_SHARE)
        wanted[USER_BITS] = self.user.likely
        return judge(levels, wanted, self._free)

    def rate(self, sample_rate: int) -> FrameRate:
        """The rate of those still possible whose words are as long as the ones heard."""
        length = WORD_CELLS * self.grid[1]
        if self._first is not None and self.number > self._first[0] + 2:
            length = (self.grid[0] - self._first[1]) / (self.number - self._first[0])
        return closest_rate(self._rates, sample_rate / length)

    def miss(self) -> None:
        """The word could not be read; the next is expected where it would be."""
        self.misses += int(self.number >= 0)  # negative numbers: perhaps before the signal
        self._next(moved_grid(self.grid, float(WORD_CELLS)))

    def hit(self, fit: WordFit, good: bool) -> tuple[float, float]:
        """The word was read: the first edge of its bit 0 and the standard deviation; moves on."""
        if not good:
            self.misses += int(self.number >= 0)
            edge, std = self._pace.passed(self.grid, fit)
            self._next(moved_grid(self.grid, float(WORD_CELLS)))
            return edge, std
        self.misses = 0
        if self._first is None:
            self._first = self.number, fit.middle
        edge, std, grid = self._pace.take(self.number, fit)
        self._next(grid)
        return edge, std

    def learns(self, share: float) -> bool:
        """Whether the next word should teach the shape of a step: most at first."""
        words = self.shape.words
        often = 1 if words < LEARN_ALL else 3 if words < LEARN_MANY else RARELY
        return share > CLEAN_SHARE and self.number % often == 0

    def restart(self, grid: Array, number: int, solution: Solution) -> Follow:
        """The same signal from an earlier word on, with what is known by now."""
        grid, line = self._pace.early(grid, number)
        pace = Pace(self.reverse, self._pace.bending, line)
        return Follow(grid, number, self.reverse, solution, pace, self.shape, self.user)

    def _keep(self, countings: list[tuple[Counting, float]]) -> None:
        """The countings that are still possible."""
        self._countings = countings
        self._rates = possible_rates([counting.rate for counting, _ in countings])

    def _next(self, grid: Array) -> None:
        self.grid = grid
        self.number += 1


def _digits(label: Timecode) -> Digits:
    """What tells labels apart."""
    return label.hours, label.minutes, label.seconds, label.frames, label.rate.drop_frame
