"""Which labels a stretch of words has: all words are judged together against labels that count on.

A word alone may be unreadable, or be read as something else. So the most likely labels of the whole stretch
are proposed from soft bits, field by field. Each proposal is judged by how much worse the levels of all
words fit if its bits are given, in nats (natural logarithms of probability ratios). The best one is
believed if it is far ahead of the next, if no other explains the words better through echoes, and if enough
words confirm it alone.

Echoes of a room make the same error in every word; a linear channel tells right labels from wrong ones.
Echoes of one word fall on the same bits of the next, as most bits of words do not change. They turn bits in
pairs (where the edge between two bits is lost another appears, so the parity of the word does not show it),
and they do so in every word, so more words do not help. But echoes are linear: a filter as long as a word
explains the levels if the labels are right, and leaves large residuals if they are wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from panoptic_ros.timecode.label.counting import Counting, proposals
from panoptic_ros.timecode.label.evidence import Evidence, UserBits, Verdict, free_score, judge, soft_nats
from panoptic_ros.timecode.word.layout import SYNC_ONLY, USER_BITS, known_bits
from panoptic_ros.timecode.word.viterbi import WordLevels

Array = np.ndarray
WORST_NATS = 40.0  # that one word can count against labels
AHEAD_NATS = 16.0  # of the next best labels
DOUBT_NATS, DOUBTFUL = 60.0, 4  # labels up to so far behind, and so many, are compared for echoes
ECHO_WORDS = 5  # that are needed to estimate the channel where labels are in doubt
CONTRADICTION_NATS = 6.0  # by which echoes must speak against the best labels
LATE = 160  # half cells by which echoes come late, at most: a word
EARLY = 2  # half cells by which a filter of zero phase or an inexact grid spreads edges forward
PRIOR = 0.01  # variance of noise over that of a coefficient of the filter


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


def echo_nats(levels: Sequence[Array], signs: Sequence[Array]) -> float:
    """How badly signs explain levels through the linear channel that fits best; only differences matter.

    Args:
        levels: (160,) of the half cells of consecutive words in the order of the stream.
        signs: (160,) of each word.

    Returns: nats, if noise is Gaussian and of unknown level.
    """
    heard, sent = np.concatenate(levels).astype(np.float64), np.concatenate(signs).astype(np.float64)
    late = min(LATE, len(heard) // 4)
    shifted = np.lib.stride_tricks.sliding_window_view(sent, late + EARLY)
    answers = heard[late - 1 : late - 1 + len(shifted)]
    power = float(answers @ answers)
    if power <= 0.0:
        return 0.0
    ridge = PRIOR * len(answers)
    normal = shifted.T @ shifted + ridge * np.eye(late + EARLY)
    filtered = np.linalg.solve(normal, shifted.T @ answers)
    rest = answers - shifted @ filtered
    unexplained = float(rest @ rest) + ridge * float(filtered @ filtered)
    return 0.5 * len(answers) * float(np.log(max(unexplained / power, 1e-12)))
