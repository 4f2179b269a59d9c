"""Which labels the words of a signal may have: those of every counting that is still possible."""

from __future__ import annotations

import numpy as np

from panoptic_ros.domain import FrameRate, Timecode
from panoptic_ros.timecode.label.counting import Counting, closest_rate, possible_rates
from panoptic_ros.timecode.label.evidence import Evidence, UserBits, Verdict
from panoptic_ros.timecode.label.stretch import WORST_NATS, Solution
from panoptic_ros.timecode.word.viterbi import WordLevels

SURE_NATS = 10.0  # by which other labels must be worse
RULED_OUT_NATS = 30.0  # by which a counting is so much worse that it is forgotten
UPHELD_NATS = 6.0  # of the labels beside, before words are reported
Digits = tuple[int, int, int, int, bool]


class ExpectedLabels:
    """The labels that the words of a signal may have, and its user bits.

    Args:
        solution: of the words that the signal was found by.
        user: what is known of the user bits; from the solution if it is not given.
    """

    def __init__(self, solution: Solution, user: UserBits | None = None):
        self.user = UserBits(solution.user) if user is None else user
        self._solution = solution
        self._countings: list[tuple[Counting, float]] = []  # nats that the best is ahead
        self._rates: list[tuple[FrameRate, float]] = []
        self._ahead = 0.0  # nats of the labels beside, by the words that are not upheld yet
        self._evidence: Evidence | None = None  # of the word that was judged last
        self._labels: list[Timecode] = []  # of that word, one for each counting
        self._verdicts: dict[Digits, Verdict] = {}  # on those labels
        self._last_ahead = 0.0  # of that word
        self.begin()

    @property
    def first(self) -> int:
        """Number of the first good word of those that the signal was found by."""
        return self._solution.first

    def begin(self) -> None:
        """Forget all but the words that the signal was found by."""
        self._keep([(counting, 0.0) for counting in self._solution.countings])
        self._ahead = 0.0

    def judge(self, number: int, levels: WordLevels) -> Verdict:
        """Judge a word against the most likely label that it may have."""
        evidence = self._evidence = Evidence(levels, self.user)
        self._labels = [counting.label(number) for counting, _ in self._countings]
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

        If the word is good, it also tells which countings are likely.
        """
        labels = self._labels
        if len(labels) == 1:
            return labels[0], True
        digits = [_digits(label) for label in labels]
        countings = self._countings
        if good:
            nats = {each: min(verdict.nats, WORST_NATS) for each, verdict in self._verdicts.items()}
            countings = [(counting, n + nats[each]) for (counting, n), each in zip(countings, digits)]
        least = min(n for _, n in countings)
        best = next(k for k, (_, n) in enumerate(countings) if n == least)
        likely = {each for (_, n), each in zip(countings, digits) if n < least + SURE_NATS}
        self._keep([(counting, n - least) for counting, n in countings if n < least + RULED_OUT_NATS])
        return labels[best], likely == {digits[best]}

    def bits(self, label: Timecode, good: bool) -> Verdict:
        """The bits of the word judged last, user bits as those of others unless it clearly has its own."""
        verdict, evidence = self._verdicts[_digits(label)], self._evidence
        assert evidence is not None
        if evidence.same_user:
            return verdict
        if good:
            self.user.hear(evidence.soft_user(label), evidence.contradiction, verdict.clean)
        return evidence.with_user(label, self.user.likely)

    def upheld(self, good: bool, early: bool, read: int) -> bool:
        """Whether the words up to the one judged last, if good, have none of the labels beside theirs.

        Args:
            early: whether the word is before those that the signal was found by.
            read: good words so far; what has counted on goes on.
        """
        self._ahead = self._ahead + self._last_ahead if good else 0.0
        if early or self._ahead < UPHELD_NATS - np.log1p(read):
            return False
        self._ahead = 0.0
        return True

    def rate(self, words_per_second: float) -> FrameRate:
        """The rate of those still possible that is closest to what was measured."""
        return closest_rate(self._rates, words_per_second)

    def _keep(self, countings: list[tuple[Counting, float]]) -> None:
        self._countings = countings
        self._rates = possible_rates([counting.rate for counting, _ in countings])


def _digits(label: Timecode) -> Digits:
    """What tells labels apart."""
    return label.hours, label.minutes, label.seconds, label.frames, label.rate.drop_frame
