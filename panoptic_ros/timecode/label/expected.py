"""Keep the labels that the next words of a signal may have: those of every counting still possible."""

from __future__ import annotations

import numpy as np

from panoptic_ros.domain import FrameRate, Timecode
from panoptic_ros.timecode.label.counting import LabelSequence, closest_rate, possible_rates
from panoptic_ros.timecode.label.evidence import LabelLikelihood, LabelScore, UserBits
from panoptic_ros.timecode.label.stretch import WORST_NATS, StretchLabels
from panoptic_ros.timecode.word.viterbi import WordLevels

SURE_NATS = 10.0  # nats by which all other labels must be worse for a label to be certain
RULED_OUT_NATS = 30.0  # a counting worse than the best by more is dropped
UPHELD_NATS = 6.0  # nats by which the neighbouring labels must be worse before words are reported
Digits = tuple[int, int, int, int, bool]


class ExpectedLabels:
    """Labels that the words of a signal may have, and the user bits of the signal.

    Args:
        solution: countings of the words by which the signal was found.
        user: user bits so far; taken from the solution if None.
    """

    def __init__(self, solution: StretchLabels, user: UserBits | None = None):
        self.user = UserBits(solution.user) if user is None else user
        self._solution = solution
        # counting, nats by which it is worse than the best
        self._countings: list[tuple[LabelSequence, float]] = []
        self._rates: list[tuple[FrameRate, float]] = []
        self._ahead = 0.0  # nats by which the neighbouring labels are worse, summed over words not upheld yet
        self._evidence: LabelLikelihood | None = None  # evidence of the word judged last
        self._labels: list[Timecode] = []  # labels of that word, one per counting
        self._verdicts: dict[Digits, LabelScore] = {}  # verdicts on those labels
        self._last_ahead = 0.0  # nats by which the neighbours of that word's label are worse
        self.begin()

    @property
    def first(self) -> int:
        """Return the number of the first good word among those by which the signal was found."""
        return self._solution.first

    def begin(self) -> None:
        """Discard everything except the solution by which the signal was found."""
        self._keep([(counting, 0.0) for counting in self._solution.countings])
        self._ahead = 0.0

    def judge(self, number: int, levels: WordLevels) -> LabelScore:
        """Score a word against its most likely label among the possible countings."""
        evidence = self._evidence = LabelLikelihood(levels, self.user)
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
        """Return the label of the word judged last, and whether no other label is about as likely.

        A good word also updates the likelihoods of the countings.
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

    def bits(self, label: Timecode, good: bool) -> LabelScore:
        """Return the bits of the word judged last, given its label.

        The user bits are those of the other words, unless this word clearly has different ones.
        """
        verdict, evidence = self._verdicts[_digits(label)], self._evidence
        assert evidence is not None
        if evidence.same_user:
            return verdict
        if good:
            self.user.hear(evidence.soft_user(label), evidence.contradiction, verdict.clean)
        return evidence.with_user(label, self.user.likely)

    def upheld(self, good: bool, early: bool, read: int) -> bool:
        """Return whether the words up to the one judged last have none of the neighbouring labels.

        Args:
            good: True if the word judged last is good; otherwise the sum of evidence restarts.
            early: True if the word precedes those by which the signal was found.
            read: number of good words so far. It lowers the threshold: labels that were consecutive so far
                are likely to continue.
        """
        self._ahead = self._ahead + self._last_ahead if good else 0.0
        if early or self._ahead < UPHELD_NATS - np.log1p(read):
            return False
        self._ahead = 0.0
        return True

    def rate(self, words_per_second: float) -> FrameRate:
        """Return the possible frame rate closest to the measured one."""
        return closest_rate(self._rates, words_per_second)

    def _keep(self, countings: list[tuple[LabelSequence, float]]) -> None:
        self._countings = countings
        self._rates = possible_rates([counting.rate for counting, _ in countings])


def _digits(label: Timecode) -> Digits:
    """Return the fields that distinguish two labels."""
    return label.hours, label.minutes, label.seconds, label.frames, label.rate.drop_frame
