"""Find the labels of a stretch of words: all words are judged together against consecutive labels.

A single word may be unreadable or misread. Therefore the most likely labels of the whole stretch are proposed
from soft bits, field by field. The score of a proposal says how much worse the levels of all words fit if its
bits are given. Scores are in nats (natural logarithms of probability ratios). The best proposal is accepted
under three conditions. It must be far ahead of the next one. No other proposal may explain the words better
through echoes. Enough words must confirm it individually.

Room echoes cause the same error in every word, so a linear channel separates right from wrong labels. Most
bits are equal in consecutive words. The echoes of one word therefore fall on the same bits of the next.
Echoes flip bits in pairs: where the edge between two bits vanishes, another appears. The parity of the word
does not reveal this. All words are affected, so more words do not help. But echoes are linear. A filter as
long as a word explains the levels if the labels are right, and leaves large residuals if they are wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from panoptic_ros.timecode.label.counting import LabelSequence, proposals
from panoptic_ros.timecode.label.evidence import (
    LabelLikelihood,
    LabelScore,
    UserBits,
    free_score,
    judge,
    soft_nats,
)
from panoptic_ros.timecode.word.layout import SYNC_ONLY, USER_BITS, known_bits
from panoptic_ros.timecode.word.viterbi import WordLevels

Array = np.ndarray
WORST_NATS = 40.0  # nats, maximum contribution of one word to the evidence against a label
AHEAD_NATS = 16.0  # minimum nats between the best labels and the next best
DOUBT_NATS, DOUBTFUL = 60.0, 4  # labels compared for echoes: maximum nats behind the best, maximum number
ECHO_WORDS = 5  # minimum number of words to estimate the channel if labels are in doubt
CONTRADICTION_NATS = 6.0  # nats by which the echo fit must contradict the best labels to reject them
LATE = 160  # half cells, maximum delay of an echo: one word
EARLY = 2  # half cells by which a zero-phase filter or an inexact grid spreads edges forward
PRIOR = 0.01  # ratio of the noise variance to the variance of a filter coefficient


@dataclass(frozen=True, slots=True)
class StretchLabels:
    """Countings that explain a stretch of words.

    Args:
        countings: countings with the accepted labels.
        user: (32,) nats in favour of ones in the user bits.
        first: number of the first good word.
    """

    countings: tuple[LabelSequence, ...]
    user: Array
    first: int


def solve_labels(words: Sequence[WordLevels], reverse: bool, least_good: int) -> StretchLabels | None:
    """Return the countings of consecutive words; the first word has number 0.

    Args:
        least_good: minimum number of readable words.

    Returns: the solution; None if the labels are in doubt or too few words are readable.
    """
    if len(words) < least_good:
        return None
    step = -1 if reverse else 1
    free = [free_score(levels) for levels in words]
    soft = np.array([np.clip(soft_nats(levels, SYNC_ONLY), -WORST_NATS, WORST_NATS) for levels in words])
    judged: dict[tuple[str, ...], _CandidateLabels] = {}
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
        judged[key] = _CandidateLabels(verdicts, [counting])
    ranked = sorted(judged.values(), key=lambda item: item.nats)
    if not ranked or not ranked[0].readable(least_good):
        return None
    best = _through_echoes(words, ranked, reverse)
    if best is None or not best.readable(least_good):
        return None
    user = soft[:, USER_BITS].sum(axis=0)
    alone = _each_alone(words, best.countings[0], UserBits(user))
    if not _CandidateLabels(alone, best.countings).readable(least_good):
        return None  # timecode that is stopped or stutters
    first = next(number for number, verdict in enumerate(alone) if verdict.good)
    return StretchLabels(tuple(best.countings), user, first)


def _each_alone(words: Sequence[WordLevels], counting: LabelSequence, user: UserBits) -> list[LabelScore]:
    """Return the verdict of each word on its label, compared with the labels of the neighbouring frames."""
    verdicts = []
    for number, levels in enumerate(words):
        label, evidence = counting.label(number), LabelLikelihood(levels, user)
        verdicts.append(evidence.compared(label, evidence.verdict(label)))
    return verdicts


class _CandidateLabels:
    """Candidate labels of a stretch: verdicts of the words, and the countings that give these labels."""

    def __init__(self, verdicts: list[LabelScore], countings: list[LabelSequence]):
        self.nats = sum(min(item.nats, WORST_NATS) for item in verdicts)
        self.signs = [item.signs for item in verdicts]
        self.countings = countings
        self._good = sum(item.good for item in verdicts)

    def readable(self, least_good: int) -> bool:
        """Return whether enough words are good with these labels."""
        return self._good >= max(least_good, 0.5 * len(self.signs))


def _through_echoes(
    words: Sequence[WordLevels], ranked: list[_CandidateLabels], reverse: bool
) -> _CandidateLabels | None:
    """Return the best labels, or close ones that explain the words better through echoes; None in doubt."""
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
    """Return how badly signs explain levels through the best linear channel; only differences matter.

    Args:
        levels: (160,) half-cell levels of consecutive words, in stream order.
        signs: (160,) half-cell signs of each word.

    Returns: nats, for Gaussian noise of unknown variance.
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
