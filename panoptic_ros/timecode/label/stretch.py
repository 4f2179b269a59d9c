"""Which labels a stretch of words has: all words are judged together against labels that count on.

A word alone may be unreadable, or be read as something else. So the most likely labels of the whole stretch
are proposed from soft bits, field by field. Each proposal is judged by how much worse the levels of all
words fit if its bits are given, in nats (natural logarithms of probability ratios). The best one is
believed if it is far ahead of the next, if no other explains the words better through echoes, and if enough
words confirm it alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from panoptic_ros.timecode.label.counting import Counting, proposals
from panoptic_ros.timecode.label.echoes import echo_nats
from panoptic_ros.timecode.label.evidence import Evidence, Verdict, free_score, judge, soft_nats
from panoptic_ros.timecode.label.user_bits import UserBits
from panoptic_ros.timecode.word.layout import SYNC_ONLY, USER_BITS, known_bits
from panoptic_ros.timecode.word.levels import WordLevels

Array = np.ndarray
WORST_NATS = 40.0  # that one word can count against labels
AHEAD_NATS = 16.0  # of the next best labels
DOUBT_NATS, DOUBTFUL = 60.0, 4  # labels up to so far behind, and so many, are compared for echoes
ECHO_WORDS = 5  # that are needed to estimate the channel where labels are in doubt
CONTRADICTION_NATS = 6.0  # by which echoes must speak against the best labels


@dataclass(frozen=True, slots=True)
class Solution:
    """Countings that explain a stretch of words; the user bits (32,) soft; number of the first good word."""

    countings: tuple[Counting, ...]
    user: Array
    first: int


def solve_labels(words: Sequence[WordLevels], reverse: bool, least_good: int) -> Solution | None:
    """The countings of consecutive words, the first of which has number 0.

    Args:
        least_good: words that must be readable.
    """
    if len(words) < least_good:
        return None
    step = -1 if reverse else 1
    free = [free_score(levels) for levels in words]
    soft = np.array([np.clip(soft_nats(levels, SYNC_ONLY), -WORST_NATS, WORST_NATS) for levels in words])
    judged: dict[tuple[str, ...], _Judged] = {}
    for counting in proposals(soft, step):
        labels = tuple(counting.label(number) for number in range(len(words)))
        key = tuple(str(label) for label in labels)
        if key in judged:
            if counting not in judged[key].countings:
                judged[key].countings.append(counting)
            continue
        verdicts = [
            judge(levels, known_bits(label), score) for levels, label, score in zip(words, labels, free)
        ]
        judged[key] = _Judged(verdicts, [counting])
    ranked = sorted(judged.values(), key=lambda item: item.nats)
    if not ranked or not ranked[0].readable(least_good):
        return None
    best = _through_echoes(words, ranked, reverse)
    if best is None or not best.readable(least_good):
        return None
    user = soft[:, USER_BITS].sum(axis=0)
    alone = _each_alone(words, best.countings[0], UserBits(user))
    if not _Judged(alone, best.countings).readable(least_good):
        return None  # timecode that stands still or stutters
    first = next(number for number, verdict in enumerate(alone) if verdict.good)
    return Solution(tuple(best.countings), user, first)


def _each_alone(words: Sequence[WordLevels], counting: Counting, user: UserBits) -> list[Verdict]:
    """The verdict of each word on its label, compared with those of the frames beside."""
    verdicts = []
    for number, levels in enumerate(words):
        label, evidence = counting.label(number), Evidence(levels, user)
        verdicts.append(evidence.compared(label, evidence.verdict(label)))
    return verdicts


class _Judged:
    """Labels of a stretch: verdicts of its words, and the countings that have these labels."""

    def __init__(self, verdicts: list[Verdict], countings: list[Counting]):
        self.nats = sum(min(item.nats, WORST_NATS) for item in verdicts)
        self.signs = [item.signs for item in verdicts]
        self.countings = countings
        self._good = sum(item.good for item in verdicts)

    def readable(self, least_good: int) -> bool:
        """Whether enough words have these labels."""
        return self._good >= max(least_good, 0.5 * len(self.signs))


def _through_echoes(words: Sequence[WordLevels], ranked: list[_Judged], reverse: bool) -> _Judged | None:
    """The best labels, or those near them that explain the words better through echoes; None in doubt."""
    clear = len(ranked) == 1 or ranked[1].nats >= ranked[0].nats + AHEAD_NATS
    crowded = len(ranked) > DOUBTFUL and ranked[DOUBTFUL].nats < ranked[0].nats + AHEAD_NATS
    if crowded or (not clear and len(words) < ECHO_WORDS):
        return None
    near = [item for item in ranked[:DOUBTFUL] if item.nats < ranked[0].nats + DOUBT_NATS]
    if len(near) == 1:
        return near[0]
    turn = slice(None, None, -1 if reverse else 1)
    levels = [word.halves[turn] for word in words]
    nats = [echo_nats(levels, [signs[turn] for signs in item.signs]) for item in near]
    first, second = np.argsort(nats)[:2]
    if clear and nats[first] > nats[0] - CONTRADICTION_NATS:
        return near[0]
    return near[first] if nats[first] < nats[second] - AHEAD_NATS else None
