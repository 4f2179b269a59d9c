"""The evidence of one word for a label: against all other labels, and against those of the frames beside it.

Timecode that stands still sends labels that differ in few bits from those that count on, and a user bit
beside them can hide the turned polarity that shows it. So if a word has the user bits of the words before,
whatever its label is, labels are judged with these bits. And a label must be more likely than those next to
it. All evidence is in nats (natural logarithms of probability ratios).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from panoptic_ros.domain import Timecode
from panoptic_ros.timecode.word.layout import FREE, USER_BITS, USER_WEIGHTS, WORD_CELLS, known_bits
from panoptic_ros.timecode.word.viterbi import LEAST_NOISE, WordLevels, best_path, match, soft_bits

Array = np.ndarray
GOOD_NATS = 15.0  # by which a word may contradict its label
LEAST_QUALITY = 0.8  # share of the levels' magnitude that the bits must explain
LEAST_TENTH = 0.25  # of the word's level, in each tenth of it: a cut word has less
LEAST_ANYWHERE = 0.1  # in a tenth that begins anywhere: silence has less
POSSIBLE_NATS, POSSIBLE_QUALITY = 150.0, 0.7  # the same for words between good ones
CLEAN_SHARE = 0.93  # of the levels that bits explain if there is no click
CLEAR_NATS = 1.0  # a clean word that contradicts its label by less cannot have another
USER_NATS = 8.0  # by which a word may contradict the user bits of others and still share them
BESIDE = (-1, 1, -2, 2, -3, 3, -4, 4)  # frames: timecode that stands still is lost after so many
BEHIND_NATS = 24.0  # of the labels beside: a word that clicks spoil may be so far behind
NO_BITS = np.full(WORD_CELLS, FREE, np.int8)
CERTAIN = 12.0  # nats for every bit
OTHER_NATS = 15.0  # by which a clear word must contradict what was certain
MANY_NATS = 90.0  # by which any word must: several bits; a click turns one or two


@dataclass(frozen=True, slots=True)
class Verdict:
    """How a label fits a word.

    Args:
        nats: by which the levels contradict the label, at least 0.
        bits: (80,) the most likely ones with this label.
        signs: (160,) of the half cells.
        level: of the signal.
        share: of the levels' magnitude that is explained.
        good: whether the word is there and has this label.
        possible: whether it may have it; clicks contradict for a moment.
        ahead: nats by which the labels of the frames beside fit worse; infinite if they were not compared.
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
        """Whether no click or noise spoils the word."""
        return self.share > CLEAN_SHARE


def judge(levels: WordLevels, wanted: Array, free: float | None = None) -> Verdict:
    """Judge how a label fits a word.

    Args:
        wanted: (80,) the label's bits.
        free: the score of the best path without a label, if known.
    """
    if free is None:
        free = free_score(levels)
    fit = match(levels.halves, wanted, levels.before, free)
    whole = fit.anywhere > LEAST_ANYWHERE * fit.level > 0.0
    even = fit.tenth > LEAST_TENTH * fit.level
    good = whole and even and fit.nats < GOOD_NATS and fit.share > LEAST_QUALITY
    possible = whole and fit.nats < POSSIBLE_NATS and fit.share > POSSIBLE_QUALITY
    return Verdict(fit.nats, fit.bits, fit.signs, fit.level, fit.share, good, possible)


def free_score(levels: WordLevels) -> float:
    """The score of the best path without a label."""
    return float(best_path(levels.halves, NO_BITS, levels.before).score)


def soft_nats(levels: WordLevels, wanted: Array) -> Array:
    """Nats (80,) for ones, given some bits (80,)."""
    halves = levels.halves
    level = (best_path(halves, wanted, levels.before).score - abs(levels.before)) / len(halves)
    noise = max(float(halves @ halves) / len(halves) - level * level, (LEAST_NOISE * level) ** 2, 1e-30)
    return level * soft_bits(halves, wanted, levels.before) / noise


class UserBits:
    """User bits by all words of a signal. What was certain stays until words clearly say something else.

    Args:
        soft: (32,) nats for ones from words that were judged together.
    """

    def __init__(self, soft: Array):
        self._nats = soft.astype(np.float64)
        self.certain = bool(np.abs(soft).min() > CERTAIN)
        self._believe((soft > 0.0).astype(np.int8))
        self._other = -1  # what the last clear word said instead

    @property
    def likely(self) -> Array:
        """(32,) the most likely bits."""
        return self._bits

    @property
    def value(self) -> int:
        """The last bits that were certain; 0 before."""
        return self._value if self.certain else 0

    def hear(self, soft: Array, contradiction: float, clear: bool) -> None:
        """Learn from a good word.

        Args:
            soft: (32,) nats for ones.
            contradiction: nats by which it fits better without the likely bits.
            clear: whether no click or noise spoils it.
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


class Evidence:
    """The evidence of one word.

    Args:
        user: what is known of the user bits.
    """

    def __init__(self, levels: WordLevels, user: UserBits):
        self._levels = levels
        self._free = free_score(levels)
        self._user = user.likely
        self.contradiction = 0.0  # nats by which it fits better without the user bits that are known
        self.same_user = False
        if user.certain:
            bits = NO_BITS.copy()
            bits[USER_BITS] = user.likely
            self.contradiction = judge(levels, bits, self._free).nats
            self.same_user = self.contradiction < USER_NATS
            if self.same_user:
                self._free = float(best_path(levels.halves, bits, levels.before).score)

    def verdict(self, label: Timecode) -> Verdict:
        """The verdict on a label."""
        return judge(self._levels, self._wanted(label), self._free)

    def compared(self, label: Timecode, found: Verdict) -> Verdict:
        """The verdict on a label, compared with the labels beside it if the word is not clear."""
        if found.clean and found.nats < CLEAR_NATS:
            return found
        beside = (Timecode.from_frame_count(label.frame_count + step, label.rate) for step in BESIDE)
        ahead = min(self.verdict(other).nats for other in beside) - found.nats
        possible = found.possible and ahead > -BEHIND_NATS
        return replace(found, good=found.good and ahead >= 0.0, possible=possible, ahead=ahead)

    def with_user(self, label: Timecode, user: Array) -> Verdict:
        """The verdict on a label with user bits (32,)."""
        wanted = known_bits(label)
        wanted[USER_BITS] = user
        return judge(self._levels, wanted, self._free)

    def soft_user(self, label: Timecode) -> Array:
        """Nats (32,) for ones in the user bits of a word with a label."""
        nats: Array = soft_nats(self._levels, known_bits(label))[USER_BITS]
        return nats

    def _wanted(self, label: Timecode) -> Array:
        wanted = known_bits(label)
        if self.same_user:
            wanted[USER_BITS] = self._user
        return wanted
