"""Labels are believed only when a stretch of words has them and no others fit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoptic_ros.domain import AudioBlock, Timecode
from panoptic_ros.simulation.ltc_channel import ChannelDistortion, play_ltc
from panoptic_ros.simulation.ltc_signal import AudioFaults, timecode_rate, word_bits
from panoptic_ros.timecode.config import TimecodeConfig
from panoptic_ros.timecode.label.counting import closest_rate, possible_rates, proposals
from panoptic_ros.timecode.label.evidence import NO_BITS, judge
from panoptic_ros.timecode.label.stretch import echo_nats, solve_labels
from panoptic_ros.timecode.stage import TimecodeStage
from panoptic_ros.timecode.word.layout import COUNTINGS, DROP_RATE, TABLES, known_bits
from panoptic_ros.timecode.word.viterbi import WordLevels, best_path

USER = 0x26110721
WORDS = 9  # of the rooms with echoes


def halves_of(label: Timecode, noise: float, rng: np.random.Generator) -> np.ndarray:
    sign, levels = rng.choice([-1.0, 1.0]), []
    for bit in word_bits(label, USER):
        levels += [sign, -sign] if bit else [sign, sign]
        sign = sign if bit else -sign
    return np.array(levels) + noise * rng.standard_normal(160)


def stretch(rate: str, first: int, step: int, count: int, noise: float, seed: int = 0) -> tuple[list, list]:
    rng = np.random.default_rng(seed)
    labels = [Timecode.from_frame_count(first + step * k, timecode_rate(rate)) for k in range(count)]
    return labels, [WordLevels(halves_of(label, noise, rng)) for label in labels]


@settings(max_examples=25, deadline=None)
@given(
    st.sampled_from(["24", "25", "29.97df", "30"]),
    st.integers(0, 2_073_599),
    st.booleans(),
    st.integers(0, 99),
)
def test_labels_are_solved_through_noise(rate: str, first: int, reverse: bool, seed: int) -> None:
    """At 0.75 of the level (-3 dB at 16 kHz), where hardly a word can be read alone."""
    labels, words = stretch(rate, first, -1 if reverse else 1, 12, 0.75, seed)
    solution = solve_labels(words, reverse, 3)
    if solution is not None:  # a stretch may have several explanations
        for counting in solution.countings:
            assert [str(counting.label(k)) for k in range(12)] == [str(label) for label in labels]


@pytest.mark.parametrize("count", [107_995, 107_892 * 24 - 5, 1795, 59 * 1800 + 12])
@pytest.mark.parametrize("rate", ["29.97df", "30", "25"])
def test_turns_of_seconds_minutes_hours_and_days(rate: str, count: int) -> None:
    for step in (1, -1):
        labels, words = stretch(rate, count + 5 - 5 * step, step, 10, 0.5)
        solution = solve_labels(words, step < 0, 3)
        assert solution is not None
        assert [str(solution.countings[0].label(k)) for k in range(10)] == [str(x) for x in labels]
        number = sum(int(bit > 0) << i for i, bit in enumerate(solution.user))
        assert number == USER


def test_noise_and_words_that_do_not_count_have_no_labels() -> None:
    rng = np.random.default_rng(1)
    assert solve_labels([WordLevels(halves) for halves in rng.standard_normal((12, 160))], False, 3) is None
    _, words = stretch("25", 1000, 1, 6, 0.1)
    assert solve_labels(words, False, 3) is not None
    assert solve_labels(words, True, 3) is None  # they count the other way
    assert solve_labels(words[:2], False, 3) is None
    assert solve_labels([words[k] for k in (0, 3, 1, 5, 2, 4)], False, 3) is None
    random = [
        WordLevels(halves_of(Timecode.from_frame_count(int(n), timecode_rate("25")), 0.1, rng))
        for n in rng.integers(0, 2_000_000, 6)
    ]
    assert solve_labels(random, False, 3) is None


def test_verdicts() -> None:
    (right, wrong), (word, _) = stretch("30", 1000, 1, 2, 0.1)
    assert judge(word, known_bits(right)).good
    assert judge(WordLevels(-3.0 * word.halves), known_bits(right)).good
    assert not judge(word, known_bits(wrong)).good
    cut = word.halves.copy()
    cut[120:] = 0.0
    assert not judge(WordLevels(cut), known_bits(right)).good
    assert not judge(WordLevels(np.zeros(160)), known_bits(right)).good


def test_the_word_before_tells_labels_that_differ_in_bit_0_only() -> None:
    """Alone, a word says it by its first half cell; a sync word with the other polarity says it 32 times."""
    (even, odd), (word, _) = stretch("30", 1000, 1, 2, 0.1)
    assert judge(word, known_bits(odd)).nats < 20.0
    sign = float(np.sign(word.halves[0]))
    told = WordLevels(word.halves, 32.0 * sign)
    assert judge(told, known_bits(even)).good
    assert judge(told, known_bits(odd)).nats > 60.0


def test_rates_by_counting_and_length() -> None:
    assert closest_rate(possible_rates({COUNTINGS[1]}), 29.0) == timecode_rate("25")
    assert closest_rate(possible_rates({COUNTINGS[0]}), 23.98) == timecode_rate("23.976")
    assert closest_rate(possible_rates(COUNTINGS[:3]), 29.972) == timecode_rate("29.97")
    assert closest_rate(possible_rates({COUNTINGS[2]}), 29.999) == timecode_rate("30")
    assert closest_rate(possible_rates({DROP_RATE}), 33.0) == timecode_rate("29.97df")


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 999), st.booleans())
def test_all_labels_that_are_near_the_most_likely_are_proposed(seed: int, reverse: bool) -> None:
    """Echoes turn the same bits in every word, so that the right label may be the third in a field."""
    rng, count, step = np.random.default_rng(seed), 5, -1 if reverse else 1
    middle = Timecode(int(rng.integers(24)), int(rng.integers(60)), int(rng.integers(60)), 12, COUNTINGS[1])
    frames = [middle.frame_count + step * (k - 2) for k in range(count)]
    words = [word_bits(Timecode.from_frame_count(frame, middle.rate), USER) for frame in frames]
    turned = rng.normal(0.0, 10.0, 80)
    turned[TABLES["frames"][0]] = 0.0
    soft = 20.0 * np.array(words) - 10.0 + turned + rng.normal(0.0, 2.0, (count, 80))
    proposed = {str(each.label(2)) for each in proposals(soft, step)}
    scores = {name: (soft[:, places] @ rows.T).sum(axis=0) for name, (places, rows) in TABLES.items()}
    total = scores["hours"][:, None, None] + scores["minutes"][:, None] + scores["seconds"]
    likely = [np.unravel_index(k, total.shape) for k in np.argsort(-total, axis=None)[:8]]
    for hours, minutes, seconds in likely:
        if total[hours, minutes, seconds] > total.max() - 60.0:
            assert str(Timecode(int(hours), int(minutes), int(seconds), 12, middle.rate)) in proposed


# ---- echoes turn the same bits of every word: labels are not believed for being the same in all of them


def signs_of(labels: list[Timecode], turned: tuple[int, ...] = ()) -> np.ndarray:
    """(W, 160), with some bits of each word turned."""
    sign, signs = 1.0, []
    for label in labels:
        for place, bit in enumerate(word_bits(label, 0x51A2B3C4)):
            one = bit != (place in turned)
            signs += [sign, -sign] if one else [sign, sign]
            sign = sign if one else -sign
    return np.array(signs).reshape(-1, 160)


def counting(first: int) -> list[Timecode]:
    return [Timecode.from_frame_count(first + k, timecode_rate("30")) for k in range(WORDS)]


def test_a_linear_channel_explains_the_signs_that_were_sent_and_no_others() -> None:
    """Two bits turned in every word keep its parity, as echoes do."""
    labels = counting(1_000_000)
    sent = signs_of(labels)
    for seed in range(5):
        rng = np.random.default_rng(seed)
        room = 0.6 * rng.standard_normal(120) * np.exp(-np.arange(120) / 30.0)
        room[0] = 1.0
        heard = np.convolve(sent.ravel(), room)[: sent.size] + 0.2 * rng.standard_normal(sent.size)
        levels = list(heard.reshape(-1, 160))
        right = echo_nats(levels, list(sent))
        for turned in ((31, 32), (41, 42), (52, 53)):
            assert echo_nats(levels, list(signs_of(labels, turned))) > right + 16.0
        assert abs(echo_nats(levels, list(-sent)) - right) < 1e-6  # of no polarity
        read = [best_path(word, NO_BITS, 0.0)[2] for word in levels]
        assert echo_nats(levels, read) > right - 1e-6


def test_silence_speaks_for_no_signs() -> None:
    signs = list(signs_of(counting(5)))
    assert echo_nats([np.zeros(160)] * WORDS, signs) == 0.0


def test_a_room_that_turns_a_minute_in_every_word() -> None:
    """Reverberation 3 dB below the direct sound: word by word the minute before fits better."""
    rng = np.random.default_rng([3, 48000])
    speed = 1.0 + 4e-5 * rng.uniform(-1.0, 1.0)
    start = Timecode.from_frame_count(int(rng.integers(0, 2_000_000)), timecode_rate("30"))
    lead = 0.5 + rng.uniform(0.0, 1.0) / 48000
    user = int(rng.integers(0, 2**32))
    faults = AudioFaults(seed=3, snr_db=50.0)
    channel = ChannelDistortion(speed=speed, seed=3, faults=faults, echo_s=0.5, direct_db=3.0)
    clip = play_ltc(start, 300, 48000, channel, lead=lead, user_bits=user)
    samples = clip.samples[: int(1.5 * 48000)]
    stage = TimecodeStage(TimecodeConfig())
    readings = [*stage.step(AudioBlock("mic", 0, 0, 48000, samples)).outputs, *stage.flush().outputs]
    truth = {str(label): at for label, at in zip(clip.labels, clip.starts)}
    assert len(readings) >= 26
    for reading in readings:
        assert abs(reading.start_sample - truth[str(reading.timecode)]) < 10.0
