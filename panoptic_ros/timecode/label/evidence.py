"""Score a label for one word, against all other labels and against the labels of neighbouring frames.

A repeated label of stopped timecode differs from the consecutive label in few bits. User bits that are read
wrongly can hide this difference. Therefore the user bits of earlier words are used as known bits, if the word
agrees with them. A label must also be more likely than its neighbours. All scores are in nats (natural
logarithms of probability ratios).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from panoptic_ros.domain import Timecode
from panoptic_ros.timecode.word.layout import FREE, USER_BITS, USER_WEIGHTS, WORD_CELLS, known_bits
from panoptic_ros.timecode.word.viterbi import LEAST_NOISE, WordLevels, best_path, match, soft_bits

Array = np.ndarray
GOOD_NATS = 15.0  # maximum nats by which a good word may contradict its label
LEAST_QUALITY = 0.8  # share of the level magnitude that the bits must explain
# minimum mean level of each of ten adjacent tenths of a word, relative to the level of the word; a cut word
# has less
LEAST_TENTH = 0.25
# minimum mean level of a sliding tenth of a word, relative to the level of the word; silence has less
LEAST_ANYWHERE = 0.1
# limits as GOOD_NATS and LEAST_QUALITY, for a word between good words
POSSIBLE_NATS, POSSIBLE_QUALITY = 150.0, 0.7
CLEAN_SHARE = 0.93  # share of the levels that the bits explain if there is no click
# nats; a clean word that contradicts its label by less than this is not compared with other labels
CLEAR_NATS = 1.0
USER_NATS = 8.0  # maximum nats by which a word may contradict the user bits that it shares with other words
# frames, offsets of the neighbouring labels; timecode that has stopped for more than 4 words is considered
# lost
BESIDE = (-1, 1, -2, 2, -3, 3, -4, 4)
# maximum nats by which a word with clicks may fit a neighbouring label better than its own label
BEHIND_NATS = 24.0
NO_BITS = np.full(WORD_CELLS, FREE, np.int8)
CERTAIN = 12.0  # minimum nats of every bit of certain user bits
OTHER_NATS = 15.0  # minimum nats by which a clear word must contradict the certain bits to change them
# minimum nats by which an unclear word must contradict the certain bits to change them: several bits must
# differ, as a click flips one or two
MANY_NATS = 90.0


@dataclass(frozen=True, slots=True)
class LabelScore:
    """Score of a label for a word.

    Args:
        nats: amount by which the levels contradict the label, at least 0.
        bits: (80,) most likely bits with this label.
        signs: (160,) signs of the half cells.
        level: mean level of the signal.
        share: share of the level magnitude that the bits explain.
        good: True if the word is present and has this label.
        possible: True if the word may have this label; clicks can contradict it briefly.
        ahead: nats by which the labels of the neighbouring frames fit worse; infinite if not compared.
    """

    nats: float
    bits: Array
    signs: Array
    level: float
    share: float
    good: bool
    possible: bool
    ahead: float = np.inf

    @property
    def clean(self) -> bool:
        """Return whether the word is free of clicks and noise."""
        return self.share > CLEAN_SHARE


def judge(levels: WordLevels, wanted: Array, free: float | None = None) -> LabelScore:
    """Score how well a label fits a word.

    Args:
        wanted: (80,) bits of the label.
        free: score of the best path without a label; computed if None.
    """
    if free is None:
        free = free_score(levels)
    fit = match(levels.halves, wanted, levels.before, free)
    whole = fit.anywhere > LEAST_ANYWHERE * fit.level > 0.0
    even = fit.tenth > LEAST_TENTH * fit.level
    good = whole and even and fit.nats < GOOD_NATS and fit.share > LEAST_QUALITY
    possible = whole and fit.nats < POSSIBLE_NATS and fit.share > POSSIBLE_QUALITY
    return LabelScore(fit.nats, fit.bits, fit.signs, fit.level, fit.share, good, possible)


def free_score(levels: WordLevels) -> float:
    """Return the score of the best path without a label."""
    return float(best_path(levels.halves, NO_BITS, levels.before).score)


def soft_nats(levels: WordLevels, wanted: Array) -> Array:
    """Return the nats (80,) in favour of a one, per bit, if the bits `wanted` (80,) are given."""
    halves = levels.halves
    level = (best_path(halves, wanted, levels.before).score - abs(levels.before)) / len(halves)
    noise = max(float(halves @ halves) / len(halves) - level * level, (LEAST_NOISE * level) ** 2, 1e-30)
    return level * soft_bits(halves, wanted, levels.before) / noise


class UserBits:
    """User bits estimated from all words of a signal. Certain bits stay until words clearly contradict them.

    Args:
        soft: (32,) nats in favour of ones, from words that were judged together.
    """

    def __init__(self, soft: Array):
        self._nats = soft.astype(np.float64)
        self.certain = bool(np.abs(soft).min() > CERTAIN)
        self._believe((soft > 0.0).astype(np.int8))
        self._other = -1  # user bits that the last clear word had instead

    @property
    def likely(self) -> Array:
        """Return the most likely bits (32,)."""
        return self._bits

    @property
    def value(self) -> int:
        """Return the last certain bits as a number; 0 before any were certain."""
        return self._value if self.certain else 0

    def hear(self, soft: Array, contradiction: float, clear: bool) -> None:
        """Update the user bits from a good word.

        Args:
            soft: (32,) nats in favour of ones.
            contradiction: nats by which the word fits free user bits better than the likely ones.
            clear: True if no click or noise distorts the word.
        """
        heard = (soft > 0.0).astype(np.int8)
        if not self.certain:
            self._nats += soft
            self._believe((self._nats > 0.0).astype(np.int8))
            self.certain = bool(np.abs(self._nats).min() > CERTAIN)
        elif contradiction > (OTHER_NATS if clear else MANY_NATS):
            other = _number(heard)
            if contradiction > MANY_NATS or other == self._other:
                self._believe(heard)
            self._other = other
        else:
            self._other = -1

    def _believe(self, bits: Array) -> None:
        self._bits, self._value = bits, _number(bits)


def _number(bits: Array) -> int:
    return int(USER_WEIGHTS @ bits)


class LabelLikelihood:
    """Likelihoods of labels for one word.

    Args:
        levels: half-cell levels of the word.
        user: user bits of the signal so far.
    """

    def __init__(self, levels: WordLevels, user: UserBits):
        self._levels = levels
        self._free = free_score(levels)
        self._user = user.likely
        self.contradiction = 0.0  # nats by which the word fits better without the known user bits
        self.same_user = False
        if user.certain:
            bits = NO_BITS.copy()
            bits[USER_BITS] = user.likely
            self.contradiction = judge(levels, bits, self._free).nats
            self.same_user = self.contradiction < USER_NATS
            if self.same_user:
                self._free = float(best_path(levels.halves, bits, levels.before).score)

    def verdict(self, label: Timecode) -> LabelScore:
        """Return the verdict on a label."""
        return judge(self._levels, self._wanted(label), self._free)

    def compared(self, label: Timecode, found: LabelScore) -> LabelScore:
        """Return the verdict on a label, compared with its neighbours unless the word is clear."""
        if found.clean and found.nats < CLEAR_NATS:
            return found
        beside = (Timecode.from_frame_count(label.frame_count + step, label.rate) for step in BESIDE)
        ahead = min(self.verdict(other).nats for other in beside) - found.nats
        possible = found.possible and ahead > -BEHIND_NATS
        return replace(found, good=found.good and ahead >= 0.0, possible=possible, ahead=ahead)

    def with_user(self, label: Timecode, user: Array) -> LabelScore:
        """Return the verdict on a label with user bits (32,)."""
        wanted = known_bits(label)
        wanted[USER_BITS] = user
        return judge(self._levels, wanted, self._free)

    def soft_user(self, label: Timecode) -> Array:
        """Return the nats (32,) in favour of ones in the user bits, given the label of the word."""
        nats: Array = soft_nats(self._levels, known_bits(label))[USER_BITS]
        return nats

    def _wanted(self, label: Timecode) -> Array:
        wanted = known_bits(label)
        if self.same_user:
            wanted[USER_BITS] = self._user
        return wanted
