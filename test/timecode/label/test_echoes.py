"""Echoes turn the same bits of every word: labels are not believed for being the same in all of them."""

from __future__ import annotations

import numpy as np

from panoptic_ros.domain import AudioBlock, Timecode
from panoptic_ros.simulation.ltc_channel import Channel, play_ltc
from panoptic_ros.simulation.ltc_signal import AudioFaults, timecode_rate, word_bits
from panoptic_ros.timecode import TimecodeConfig, TimecodeStage
from panoptic_ros.timecode.label.echoes import echo_nats
from panoptic_ros.timecode.label.evidence import NO_BITS
from panoptic_ros.timecode.word.viterbi import best_path

WORDS = 9


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
    channel = Channel(speed=speed, seed=3, faults=faults, echo_s=0.5, direct_db=3.0)
    clip = play_ltc(start, 300, 48000, channel, lead=lead, user_bits=user)
    samples = clip.samples[: int(1.5 * 48000)]
    stage = TimecodeStage(TimecodeConfig())
    readings = [*stage.step(AudioBlock("mic", 0, 0, 48000, samples)).outputs, *stage.flush().outputs]
    truth = {str(label): at for label, at in zip(clip.labels, clip.starts)}
    assert len(readings) >= 26
    for reading in readings:
        assert abs(reading.start_sample - truth[str(reading.timecode)]) < 10.0
