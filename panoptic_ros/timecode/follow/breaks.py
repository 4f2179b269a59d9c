"""Detect breaks between consecutive words: a timecode jump, or audio samples lost without being counted.

Labels, sample count and block timestamps each measure the time between two words. The measure that disagrees
with the other two is wrong.
"""

from __future__ import annotations

from dataclasses import dataclass

from panoptic_ros.domain import Timecode
from panoptic_ros.stage import Notice
from panoptic_ros.timecode.follow.reading import Word
from panoptic_ros.timecode.label.counting import with_rate
from panoptic_ros.timecode.word.layout import WORD_CELLS

LONGEST_GAP = 250  # words; over longer gaps the speed is too uncertain to predict the label
SLACK = 0.07  # relative error of the elapsed time, or of one word, caused by changing speed


@dataclass(frozen=True)
class WordReading:
    """A decoded word and its timestamp (ns)."""

    word: Word
    stamp_ns: int


def find_break(
    device: str, sample_rate: int, last: WordReading, new: WordReading
) -> tuple[Notice, ...] | None:
    """Return the notices on a break between two words of a device; None if the next word is needed.

    Audio lost inside a word shifts the start of the word, but not its timestamp yet.
    """
    samples = new.word.start - last.word.start
    passed = samples / (WORD_CELLS * new.word.cell)  # number of words between the two
    if round(passed) > LONGEST_GAP:
        return ()
    if new.word.reverse != last.word.reverse:
        return (_jump(device, new.word.timecode),)
    ahead = _labels_ahead(last.word, new.word, round(passed))
    missing = ahead + round(passed) - passed
    lost = missing * WORD_CELLS * new.word.cell  # samples, according to the labels
    by_stamps = (new.stamp_ns - last.stamp_ns) * 1e-9 * sample_rate - samples
    uneven = missing > SLACK * max(1.0, passed)
    if uneven and abs(by_stamps - lost) < 0.5 * lost:
        text = f"audio of {device} lost about {round(lost)} samples, uncounted, before {new.word.timecode}"
        return (Notice("timecode.gap", "warning", text, {"device": device}),)
    if ahead:
        return (_jump(device, new.word.timecode),)
    return None if uneven else ()


def is_one_timecode(one: WordReading, other: WordReading) -> bool:
    """Return whether words of two channels of a device can belong to the same timecode.

    The difference of their labels must agree with the time between them. This is the case if a mono input is
    opened as stereo.
    """
    words = (other.word.start - one.word.start) / (WORD_CELLS * other.word.cell)
    if abs(words) > LONGEST_GAP or other.word.reverse != one.word.reverse:
        return False
    in_step = abs(words - round(words)) < SLACK * max(1.0, abs(words))
    return in_step and not _labels_ahead(one.word, other.word, round(words))


def _labels_ahead(last: Word, new: Word, passed: int) -> int:
    """Return how many frames the new label is ahead of the label expected after `passed` words."""
    rate = new.timecode.rate
    count = with_rate(last.timecode, rate).frame_count + (-passed if new.reverse else passed)
    ahead = new.timecode.frame_count - Timecode.from_frame_count(count, rate).frame_count
    day = 24 * (107_892 if rate.drop_frame else 3600 * rate.nominal)
    ahead = (ahead + day // 2) % day - day // 2
    return -ahead if new.reverse else ahead


def _jump(device: str, label: Timecode) -> Notice:
    text = f"the timecode of {device} jumped to {label}"
    return Notice("timecode.jump", "warning", text, {"device": device})
