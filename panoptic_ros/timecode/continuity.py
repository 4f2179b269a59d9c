"""Which labels to believe: those that consecutive words agree on.

A word alone may be misread and still look right. Labels are held back until `agreeing` words in a row
count on by one; then they and all that continue them are reported. A word that does not fit
is left out; words that agree on another count start a new segment.
"""
from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np

from panoptic_ros.domain import FrameRate, Timecode
from panoptic_ros.timecode.decoder import Word
from panoptic_ros.timecode.words import WORD_CELLS, Label

DROP_RATE = FrameRate(30, Fraction(30000, 1001), True)
RATES = (
    FrameRate(24, Fraction(24000, 1001)), FrameRate(24, Fraction(24)), FrameRate(25, Fraction(25)),
    FrameRate(30, Fraction(30000, 1001)), FrameRate(30, Fraction(30)),
)  # fmt: skip
LONGEST_GAP = 250  # words; over more, counting on proves nothing about the rate


@dataclass
class _Segment:
    """Words that agree.

    Args:
        words: those not yet reported.
        last: the last one that agreed.
        first: the first one, for the mean length of a word.
        nominals: labels per second that are still possible.
    """

    words: list[Word]
    last: Word
    first: Word
    nominals: frozenset[int]
    confirmed: bool = False

    @classmethod
    def of(cls, word: Word) -> _Segment:
        label = _label(word)
        possible = {30} if label.drop_frame else {n for n in (24, 25, 30) if label.frames < n}
        return cls([word], word, word, frozenset(possible))


@dataclass
class Continuity:
    """Words in, believed words and their timecodes out."""

    agreeing: int
    sample_rate: int
    _segment: _Segment | None = None
    _rival: _Segment | None = None
    jumps: int = field(default=0, init=False)

    def push(self, word: Word) -> list[tuple[Word, Timecode]]:
        """What can be reported now."""
        if word.label is None:
            return []
        if self._segment is not None and self._extend(self._segment, word):
            self._rival = None
            return self._report(self._segment)
        if self._rival is None or not self._extend(self._rival, word):
            self._rival = _Segment.of(word)
            return []
        if not self._rival.confirmed:
            return []
        self.jumps += int(self._segment is not None)
        self._segment, self._rival = self._rival, None
        return self._report(self._segment)

    def _extend(self, segment: _Segment, word: Word) -> bool:
        """Add a word if its label follows."""
        gap = word.number - segment.last.number
        if gap < 1 or gap > LONGEST_GAP or word.reverse != segment.last.reverse:
            return False
        if not segment.confirmed and gap > 1:
            return False
        possible = frozenset(n for n in segment.nominals if _follows(segment.last, word, gap, n))
        if not possible:
            return False
        segment.nominals, segment.last = possible, word
        segment.words.append(word)
        segment.confirmed = segment.confirmed or len(segment.words) >= self.agreeing
        return True

    def _report(self, segment: _Segment) -> list[tuple[Word, Timecode]]:
        rate = self._rate(segment)
        words, segment.words = segment.words, []
        return [(word, _timecode(_label(word), rate)) for word in words]

    def _rate(self, segment: _Segment) -> FrameRate:
        """The rate of those still possible whose words are as long as the ones heard."""
        if _label(segment.last).drop_frame:
            return DROP_RATE
        words = segment.last.number - segment.first.number
        length = (segment.last.start - segment.first.start) / max(words, 1)
        if words < 2:
            length = WORD_CELLS * segment.last.cell
        measured = self.sample_rate / length
        possible = [rate for rate in RATES if rate.nominal in segment.nominals]
        return min(possible, key=lambda rate: abs(float(np.log(measured / float(rate.exact)))))


def _label(word: Word) -> Label:
    assert word.label is not None
    return word.label


def _follows(last: Word, word: Word, gap: int, nominal: int) -> bool:
    """Whether a label comes `gap` words after another, at `nominal` labels per second."""
    one, other = _label(last), _label(word)
    if one.drop_frame != other.drop_frame or max(one.frames, other.frames) >= nominal:
        return False
    rate = DROP_RATE if one.drop_frame else next(rate for rate in RATES if rate.nominal == nominal)
    step = -gap if word.reverse else gap
    expected = Timecode.from_frame_count(_timecode(one, rate).frame_count + step, rate)
    return expected == _timecode(other, rate)


def _timecode(label: Label, rate: FrameRate) -> Timecode:
    return Timecode(label.hours, label.minutes, label.seconds, label.frames, rate)
