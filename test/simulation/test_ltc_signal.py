"""Timecode as audio: bits against the standard's table, edges against the truth."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoptic_ros.domain import Timecode
from panoptic_ros.errors import UsageError
from panoptic_ros.simulation.ltc_signal import (
    AudioFaults,
    degrade_audio,
    encode_ltc,
    timecode_rate,
    word_bits,
)


def test_bits_of_a_word_by_hand() -> None:
    # 01:23:45:12 at 30, user groups 1 to 8 = 1, 2, ..., 8; every digit least significant bit first.
    label = Timecode(1, 23, 45, 12, timecode_rate("30"))
    groups = [
        "0100",
        "1000",
        "1000",
        "0100",
        "1010",
        "1100",
        "0010",
        "0010",  # 2 u1 1. u2 5 u3 4. u4
        "1100",
        "1010",
        "0100",
        "0110",
        "1000",
        "1110",
        "0000",
        "0001",  # 3 u5 2. u6 1 u7 0. u8
        "0011",
        "1111",
        "1111",
        "1101",
    ]
    assert word_bits(label, 0x87654321, balanced=False) == [int(bit) for bit in "".join(groups)]


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2_000_000), st.sampled_from(["24", "25", "29.97df", "30"]), st.integers(0, 2**32 - 1))
def test_balanced_words_have_an_even_number_of_zeros(count: int, rate: str, user: int) -> None:
    label = Timecode.from_frame_count(count, timecode_rate(rate))
    bits = word_bits(label, user)
    assert len(bits) == 80 and bits.count(0) % 2 == 0
    assert bits[10] == int(rate == "29.97df")


def test_edges_are_where_they_should_be() -> None:
    start = Timecode.from_frame_count(1234, timecode_rate("25"))
    signal = encode_ltc(start, 3, 48000, lead=100.25, speed=1.0001, amplitude=0.5)
    cell = 48000 / (25 * 80 * 1.0001)
    np.testing.assert_allclose(signal.starts, 100.25 + 80 * cell * np.arange(3))
    bits = [bit for label in signal.labels for bit in word_bits(label)]
    places = [k + half for k, bit in enumerate(bits) for half in ((0.0, 0.5) if bit else (0.0,))]
    x = signal.samples.astype(float)
    crossings = np.flatnonzero(x[:-1] * x[1:] < 0)
    found = crossings + x[crossings] / (x[crossings] - x[crossings + 1])
    # By linear interpolation; the last edge ends the signal.
    np.testing.assert_allclose(found[:-1], 100.25 + cell * np.array(places), atol=0.05)
    assert abs(np.abs(signal.samples).max() - 0.5) < 1e-6


def test_polarity_and_direction() -> None:
    start = Timecode.from_frame_count(5000, timecode_rate("30"))
    signal = encode_ltc(start, 4, 16000)
    np.testing.assert_array_equal(encode_ltc(start, 4, 16000, inverted=True).samples, -signal.samples)
    back = encode_ltc(signal.labels[-1], 4, 16000, reverse=True)
    assert back.labels == signal.labels[::-1]
    length = signal.starts[1] - signal.starts[0]
    np.testing.assert_allclose(back.starts, length * np.arange(1, 5))


def test_faults_have_the_strength_that_was_asked_for() -> None:
    signal = encode_ltc(Timecode.from_frame_count(0, timecode_rate("25")), 25, 48000)
    rms = np.sqrt(np.mean(signal.samples**2))

    def added(**faults: float) -> np.ndarray:
        return degrade_audio(signal.samples, 48000, AudioFaults(**faults)) - signal.samples

    assert np.sqrt(np.mean(added(snr_db=20.0) ** 2)) == pytest.approx(0.1 * rms, rel=0.02)
    assert np.sqrt(np.mean(added(hum_db=6.0) ** 2)) == pytest.approx(2.0 * rms, rel=0.02)
    assert added(dc=0.1).mean() == pytest.approx(0.1, abs=1e-4)
    assert not added().any()
    np.testing.assert_array_equal(added(snr_db=10.0, seed=3), added(snr_db=10.0, seed=3))


def test_nothing_to_encode() -> None:
    with pytest.raises(UsageError, match="cannot encode 0 words"):
        encode_ltc(Timecode.from_frame_count(0, timecode_rate("25")), 0, 48000)
    with pytest.raises(UsageError, match="no timecode rate '50'"):
        timecode_rate("50")
