"""Labels are believed only when consecutive words agree."""
from __future__ import annotations

import numpy as np

from panoptic_ros.domain import FrameRate, Timecode
from panoptic_ros.simulation.ltc_signal import timecode_rate
from panoptic_ros.timecode.continuity import Continuity
from panoptic_ros.timecode.decoder import Word
from panoptic_ros.timecode.words import Label

SAMPLE_RATE = 48000


def word(number: int, label: Timecode | None, rate: FrameRate, reverse: bool = False) -> Word:
    length = SAMPLE_RATE / float(rate.exact)
    read = label and Label(label.hours, label.minutes, label.seconds, label.frames, rate.drop_frame, 0)
    return Word(number, read or None, number * length, 0.01, length / 80, reverse)


def stream(rate: FrameRate, first: int, count: int) -> list[Word]:
    return [word(i, Timecode.from_frame_count(first + i, rate), rate) for i in range(count)]


def push(words: list[Word], agreeing: int = 3) -> list[tuple[int, str]]:
    continuity = Continuity(agreeing, SAMPLE_RATE)
    return [(w.number, str(timecode)) for item in words for w, timecode in continuity.push(item)]


def test_words_wait_until_enough_agree() -> None:
    words = stream(timecode_rate("25"), 100, 5)
    assert push(words[:2]) == []
    assert [number for number, _ in push(words[:3])] == [0, 1, 2]
    assert [number for number, _ in push(words, agreeing=5)] == [0, 1, 2, 3, 4]
    assert push(words, agreeing=6) == []


def test_misread_words_are_left_out() -> None:
    rate = timecode_rate("30")
    words = stream(rate, 1000, 12)
    words[5] = word(5, Timecode(12, 34, 56, 7, rate), rate)
    words[8] = word(8, None, rate)
    assert [number for number, _ in push(words)] == [0, 1, 2, 3, 4, 6, 7, 9, 10, 11]


def test_alternating_nonsense_is_never_believed() -> None:
    rate = timecode_rate("25")
    rng = np.random.default_rng(0)
    words = [word(i, Timecode.from_frame_count(int(rng.integers(0, 10**6)), rate), rate) for i in range(200)]
    assert push(words) == []


def test_unreadable_words_between_do_not_count_as_agreement() -> None:
    rate = timecode_rate("25")
    words = stream(rate, 0, 9)
    for i in (1, 3, 5, 7):
        words[i] = word(i, None, rate)
    assert push(words) == []


def test_reverse_counts_down() -> None:
    rate = timecode_rate("29.97df")
    words = [word(i, Timecode.from_frame_count(1800 - i, rate), rate, True) for i in range(6)]
    assert [label for _, label in push(words)][:3] == ["00:01:00;02", "00:00:59;29", "00:00:59;28"]


def test_the_rate_is_that_of_the_length_and_of_the_count() -> None:
    for name in ("23.976", "24", "25", "29.97", "29.97df", "30"):
        rate = timecode_rate(name)
        continuity = Continuity(3, SAMPLE_RATE)
        rates = {timecode.rate for item in stream(rate, 20, 60) for _, timecode in continuity.push(item)}
        assert rates == {rate}, name


def test_the_count_decides_when_the_speed_is_off() -> None:
    """30 labels per second, played so slowly that words are as long as those of 24."""
    continuity = Continuity(3, SAMPLE_RATE)
    thirty, slow = timecode_rate("30"), timecode_rate("24")
    words = [
        Word(w.number, w.label, w.number * SAMPLE_RATE / float(slow.exact), 0.01, 25.0, False)
        for w in stream(thirty, 0, 60)
    ]
    nominal = [timecode.rate.nominal for item in words for _, timecode in continuity.push(item)]
    assert nominal[-1] == 30 and nominal[0] == 24
