"""What one word says for a label, and timecode that stands still: what comes out was sent, or nothing."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from panoptic_ros.domain import Timecode
from panoptic_ros.simulation.ltc_signal import square_wave, timecode_rate, word_bits
from panoptic_ros.timecode.config import TimecodeConfig
from panoptic_ros.timecode.label.evidence import LabelLikelihood, UserBits, judge
from panoptic_ros.timecode.recording import decode_recording
from panoptic_ros.timecode.word.layout import USER_BITS, known_bits
from panoptic_ros.timecode.word.viterbi import WordLevels

USER = 0x26110721
RATE = 16000


def edges_of(labels: Sequence[Timecode], users: Sequence[int]) -> np.ndarray:
    """In cells."""
    bits = np.concatenate([word_bits(label, user) for label, user in zip(labels, users)])
    both = np.column_stack([np.ones_like(bits), bits]).ravel()
    return np.append(np.flatnonzero(both) * 0.5, float(len(bits)))


def levels_of(label: Timecode, noise: float = 0.0, user: int = USER) -> WordLevels:
    sign = -np.cumprod(np.where(np.isin(np.arange(160) * 0.5, edges_of([label], [user])), -1.0, 1.0))
    return WordLevels(sign + noise * np.random.default_rng(1).standard_normal(160))


def known(user: int = USER) -> UserBits:
    return UserBits(np.where([(user >> i) & 1 for i in range(len(USER_BITS))], 20.0, -20.0))


def label_of(frames: int) -> Timecode:
    return Timecode(10, 11, 12, frames, timecode_rate("30"))


@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_a_word_that_an_eighth_of_silence_fills_is_no_word(noise: float) -> None:
    """Wherever the silence is; and it is one without."""
    label = label_of(7)
    assert judge(levels_of(label, noise), known_bits(label)).good
    for first in range(0, 160 - 20 + 1):
        halves = levels_of(label, noise).halves.copy()
        halves[first : first + 20] = 0.0
        assert not judge(WordLevels(halves), known_bits(label)).possible


def test_known_user_bits_cannot_hide_a_turned_polarity() -> None:
    """Labels 21 and 29 differ in a bit beside a user bit."""
    levels, nothing = levels_of(label_of(21), 0.4), UserBits(np.zeros(32))
    alone = LabelLikelihood(levels, nothing).verdict(label_of(29)).nats
    evidence = LabelLikelihood(levels, known())
    assert evidence.same_user
    assert evidence.verdict(label_of(29)).nats > max(30.0, 1.5 * alone)
    assert evidence.verdict(label_of(21)).good


def test_a_word_with_user_bits_of_its_own_is_judged_freely() -> None:
    evidence = LabelLikelihood(levels_of(label_of(21), 0.4, user=0x01234567), known())
    assert not evidence.same_user
    assert evidence.contradiction > 30.0
    assert evidence.verdict(label_of(21)).good


def test_a_label_is_compared_with_those_beside_it() -> None:
    evidence = LabelLikelihood(levels_of(label_of(1), 0.9), known())
    right, wrong = (evidence.compared(label, evidence.verdict(label)) for label in (label_of(1), label_of(2)))
    assert right.good and right.ahead > 0.0
    assert wrong.ahead < 0.0 and not wrong.good
    clear = LabelLikelihood(levels_of(label_of(1)), known())
    assert clear.compared(label_of(1), clear.verdict(label_of(1))).ahead == np.inf  # nobody else was asked


STANDING: dict[str, tuple[Callable[[int], int], int, int]] = {
    "stops": (lambda k: min(k, 12), 0, 11),
    "stops and goes, user bits change": (lambda k: min(k, 10) + max(0, k - 16), 1, 22),
    "starts": (lambda k: max(0, k - 10), 0, 21),
    "twice": (lambda k: k // 2, 0, 0),
    "jumps": (lambda k: k + (k > 14) - 2 * (k > 24), 0, 26),
}


@pytest.mark.parametrize("name", list(STANDING))
def test_timecode_that_stands_still_is_never_read_on(name: str) -> None:
    plan, change, least = STANDING[name]
    labels = [Timecode.from_frame_count(900_000 + plan(k), timecode_rate("24")) for k in range(34)]
    edges = edges_of(labels, [USER + change * k for k in range(34)])
    cell, lead = RATE / 24 / 80, 1000.0
    clean = square_wave(lead + edges * cell, int(lead + 34 * 80 * cell + 1000), 0.5, cell)
    noisy = 0.25 * (clean + 0.7 * np.random.default_rng(3).standard_normal(len(clean)))
    readings = decode_recording(TimecodeConfig(), "mic", RATE, noisy.astype(np.float32))
    for reading in readings:
        word = round((reading.start_sample - lead) / (80 * cell))
        assert str(reading.timecode) == str(labels[word])
    assert len(readings) >= least


# ---- user bits


def soft(value: int, nats: float) -> np.ndarray:
    return np.where((value >> np.arange(32)) & 1, nats, -nats).astype(float)


def test_unknown_until_certain() -> None:
    bits = UserBits(soft(0x12345678, 5.0))
    assert bits.value == 0 and not bits.certain
    bits.hear(soft(0x12345678, 5.0), 0.0, True)
    bits.hear(soft(0x12345678, 5.0), 0.0, True)
    assert bits.value == 0x12345678


def test_a_bit_that_a_click_turns_is_not_believed_but_a_change_is() -> None:
    bits = UserBits(soft(7, 20.0))
    bits.hear(soft(6, 20.0), 30.0, True)
    assert bits.value == 7
    bits.hear(soft(7, 20.0), 0.0, True)
    bits.hear(soft(6, 20.0), 30.0, False)
    assert bits.value == 7
    bits.hear(soft(0xFFFF0000, 20.0), 400.0, True)
    assert bits.value == 0xFFFF0000
    for _ in range(2):
        bits.hear(soft(0xFFFF0001, 20.0), 30.0, True)
    assert bits.value == 0xFFFF0001
