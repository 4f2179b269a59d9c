"""A signal that is followed word by word: where the next is expected, and which labels it may have."""
from __future__ import annotations

import numpy as np

from panoptic_ros.domain import FrameRate, Timecode
from panoptic_ros.timecode.follow.pace import Pace
from panoptic_ros.timecode.label.counting import Counting
from panoptic_ros.timecode.label.evidence import CLEAN_SHARE, Evidence, Verdict
from panoptic_ros.timecode.label.rates import closest_rate, possible_rates
from panoptic_ros.timecode.label.stretch import WORST_NATS, Solution
from panoptic_ros.timecode.label.user_bits import UserBits
from panoptic_ros.timecode.signal.edge_shape import EdgeShape
from panoptic_ros.timecode.signal.grid import moved_grid
from panoptic_ros.timecode.word.fit import WordFit
from panoptic_ros.timecode.word.layout import WORD_CELLS
from panoptic_ros.timecode.word.levels import WordLevels

Array = np.ndarray
SURE_NATS = 10.0  # by which other labels must be worse
RULED_OUT_NATS = 30.0  # by which a counting is so much worse that it is forgotten
UPHELD_NATS = 6.0  # of the labels beside, before words are reported
LEARN_ALL, LEARN_MANY = 16, 50  # words; then every third, then every
RARELY = 30
Digits = tuple[int, int, int, int, bool]


class Follow:
    """A signal that was found.

    Args:
        grid: (3,) of the word with `number`, in raw samples.
        solution: of the words that it was found by.
        shape: of a step, if known.

    Attributes:
        read: good words.
        misses: words in a row that were not.
    """

    def __init__(
        self, grid: Array, number: int, reverse: bool, solution: Solution, pace: Pace, shape: EdgeShape,
        user: UserBits | None = None,
    ):  # fmt: skip
        self.grid, self.number, self.reverse = grid, number, reverse
        self.shape = shape
        self.misses = self.read = 0
        self._pace = pace
        self._solution = solution
        self._begin()
        self.user = UserBits(solution.user) if user is None else user
        self._evidence: Evidence | None = None  # of the word that was judged last
        self._labels: list[Timecode] = []  # of the word, one for each counting
        self._verdicts: dict[Digits, Verdict] = {}
        self._last_ahead = 0.0  # of the word that was judged last

    @property
    def started(self) -> bool:
        """Whether a good word was read."""
        return self._first is not None

    @property
    def early(self) -> bool:
        """Whether the next word is before those that the signal was found by, perhaps before the signal."""
        return self.number < self._solution.first

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
        evidence = self._evidence = Evidence(levels, self.user)
        self._labels = [counting.label(self.number) for counting, _ in self._countings]
        self._verdicts = {}
        for label in self._labels:
            if _digits(label) not in self._verdicts:
                self._verdicts[_digits(label)] = evidence.verdict(label)
        likely = min(self._labels, key=lambda label: self._verdicts[_digits(label)].nats)
        verdict = evidence.compared(likely, self._verdicts[_digits(likely)])
        self._last_ahead = verdict.ahead
        return verdict

    def label(self, good: bool) -> tuple[Timecode, bool]:
        """The label of the word that was judged last, and whether no other is about as likely.

        Learns which countings are likely.
        """
        labels = self._labels
        if len(labels) == 1:
            return labels[0], True
        texts = [_digits(label) for label in labels]
        heard = self._countings
        if good:
            nats = {text: min(verdict.nats, WORST_NATS) for text, verdict in self._verdicts.items()}
            heard = [(counting, n + nats[text]) for (counting, n), text in zip(heard, texts)]
        least = min(n for _, n in heard)
        best = next(k for k, (_, n) in enumerate(heard) if n == least)
        doubtful = any(text != texts[best] for (_, n), text in zip(heard, texts) if n < least + SURE_NATS)
        self._keep([(c, n - least) for c, n in heard if n < least + RULED_OUT_NATS])
        return labels[best], not doubtful

    def bits(self, label: Timecode, good: bool) -> Verdict:
        """The bits of the word judged last, user bits as those of others unless it clearly has its own."""
        verdict, evidence = self._verdicts[_digits(label)], self._evidence
        assert evidence is not None
        if evidence.same_user:
            return verdict
        if good:
            self.user.hear(evidence.soft_user(label), evidence.contradiction, verdict.clean)
        return evidence.with_user(label, self.user.likely)

    def upheld(self, good: bool) -> bool:
        """Whether the words up to the one judged last, if good, have none of the labels beside theirs."""
        self._ahead = self._ahead + self._last_ahead if good else 0.0
        if self.early or self._ahead < UPHELD_NATS - np.log1p(self.read):  # what has counted on goes on
            return False
        self._ahead = 0.0
        return True

    def rate(self, sample_rate: int) -> FrameRate:
        """The rate of those still possible whose words are as long as the ones heard."""
        length = WORD_CELLS * self.grid[1]
        if self._first is not None and self.number > self._first[0] + 2:
            length = (self.grid[0] - self._first[1]) / (self.number - self._first[0])
        return closest_rate(self._rates, sample_rate / length)

    def miss(self) -> None:
        """The word could not be read; the next is expected where it would be."""
        if self.early:
            self._begin()
        else:
            self.misses += 1
        self._next(moved_grid(self.grid, float(WORD_CELLS)))

    def hit(self, fit: WordFit, good: bool) -> tuple[float, float]:
        """The word was read: the first edge of its bit 0 and the standard deviation; moves on."""
        if not good:
            self.misses += not self.early
            edge, std = self._pace.passed(self.grid, fit)
            self._next(moved_grid(self.grid, float(WORD_CELLS)))
            return edge, std
        self.misses = 0
        self.read += 1
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

    def _begin(self) -> None:
        """Nothing is known but the words that it was found by."""
        self._keep([(counting, 0.0) for counting in self._solution.countings])
        self._first: tuple[int, float] | None = None  # number and middle of the first word that was read
        self._ahead = 0.0  # of labels beside, nats of the words that are not upheld yet

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
