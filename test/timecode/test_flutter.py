"""Tapes whose speed swings: every word is read, and its deviation says how exactly."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from panoptic_ros.domain import AudioBlock, Timecode, TimecodeReading
from panoptic_ros.simulation.ltc_channel import ChannelDistortion, play_ltc
from panoptic_ros.simulation.ltc_signal import AudioFaults, LtcSignal, timecode_rate
from panoptic_ros.timecode.config import TimecodeConfig
from panoptic_ros.timecode.recording import decode_recording
from panoptic_ros.timecode.stage import TimecodeStage

WORDS = 100


def _tape(
    rate: str,
    sample_rate: int,
    seed: int,
    reverse: bool = False,
    snr_db: float = 18.0,
    words: int = WORDS,
    **swing: Any,
) -> LtcSignal:
    channel = ChannelDistortion(
        speed=1.00003, seed=seed, faults=AudioFaults(snr_db=snr_db, seed=seed), **swing
    )
    start = Timecode.from_frame_count(40_000 + 1000 * seed, timecode_rate(rate))
    return play_ltc(start, words, sample_rate, channel, lead=0.3 + 7e-6 * seed, reverse=reverse)


def _live(samples: np.ndarray, rate: int) -> list[TimecodeReading]:
    stage, readings = TimecodeStage(TimecodeConfig()), []
    for first in range(0, len(samples), 1024):
        block = AudioBlock("tape", first * 10**9 // rate, first, rate, samples[first : first + 1024])
        readings += stage.step(block).outputs
    return [*readings, *stage.flush().outputs]


def _checked(signal: LtcSignal, readings: list[TimecodeReading], most_us: float) -> None:
    assert [str(r.timecode) for r in readings] == [str(label) for label in signal.labels]
    errors = np.array([r.start_sample for r in readings]) - signal.starts
    errors -= errors.mean()  # a delay that all words share is not in their deviations
    stds = np.array([r.std_samples for r in readings])
    assert np.sqrt(np.mean(errors**2)) * 1e6 / signal.sample_rate < most_us
    assert 0.25 < np.sqrt(np.mean((errors / stds) ** 2)) < 1.6


@pytest.mark.parametrize(
    ("rate", "sample_rate", "swing"),
    [
        ("25", 48000, {"flutter": 0.005, "flutter_hz": 9.0}),
        ("30", 48000, {"flutter": 0.005, "flutter_hz": 30.0, "wow": 0.005, "wow_hz": 0.5}),
        ("24", 16000, {"flutter": 0.005, "flutter_hz": 15.0, "wow": 0.005, "wow_hz": 3.0}),
        ("29.97df", 16000, {"flutter": 0.005, "flutter_hz": 1.0}),
        ("30", 48000, {"flutter": 0.001, "flutter_hz": 9.0}),
        ("25", 48000, {"flutter": 0.005, "flutter_hz": 9.0, "high_pass_hz": 700.0}),
    ],
)
def test_every_word_of_a_fluttering_tape_is_read(rate: str, sample_rate: int, swing: dict[str, Any]) -> None:
    signal = _tape(rate, sample_rate, 77, **swing)
    _checked(signal, _live(signal.samples, sample_rate), 8.0)
    _checked(signal, decode_recording(TimecodeConfig(), "tape", sample_rate, signal.samples), 8.0)


@pytest.mark.parametrize(("rate", "sample_rate", "swing_hz"), [("30", 48000, 0.5), ("25", 16000, 1.0)])
def test_slight_flutter_is_stated_while_words_count_as_on_a_line(
    rate: str, sample_rate: int, swing_hz: float
) -> None:
    scaled = []
    for seed in range(90, 98):
        signal = _tape(rate, sample_rate, seed, words=30, flutter=0.0002, flutter_hz=swing_hz)
        readings = _live(signal.samples, sample_rate)
        assert [str(r.timecode) for r in readings] == [str(label) for label in signal.labels]
        errors = np.array([r.start_sample for r in readings]) - signal.starts
        scaled.append(errors / [r.std_samples for r in readings])
    assert 0.4 < np.sqrt(np.mean(np.square(scaled))) < 1.4


def test_wow_of_three_percent_and_a_tape_that_runs_backwards() -> None:
    wow = _tape("30", 48000, 78, snr_db=50.0, wow=0.03, wow_hz=3.0)
    _checked(wow, decode_recording(TimecodeConfig(), "tape", 48000, wow.samples), 1.5)
    back = _tape("25", 48000, 79, reverse=True, flutter=0.005, flutter_hz=9.0)
    _checked(back, _live(back.samples, 48000), 5.0)


def test_a_tape_that_begins_and_ceases_to_flutter() -> None:
    still, swinging = (_tape("30", 48000, 80, flutter=depth, flutter_hz=9.0) for depth in (0.0, 0.004))
    there, back = 40, 70
    first, last = int(still.starts[there]), int(still.starts[back])
    begin, end = int(swinging.starts[there]), int(swinging.starts[back])
    samples = np.concatenate([still.samples[:first], swinging.samples[begin:end], still.samples[last:]])
    starts = still.starts.copy()
    starts[there:back] = swinging.starts[there:back] + first - begin
    starts[back:] += first - begin + end - last
    readings = _live(samples, 48000)
    labels = {str(label): start for label, start in zip(still.labels, starts)}
    assert len(readings) > 0.93 * WORDS
    errors = np.array([r.start_sample - labels[str(r.timecode)] for r in readings])
    assert np.abs(errors).max() < 48.0  # a splice is a jump of half a sample; flutter begins within a word
    assert np.median(np.abs(errors)) * 1e6 / 48000 < 3.0


@pytest.mark.parametrize(
    ("rate", "sample_rate", "swing"),
    [
        ("29.97", 48000, {"flutter": 0.02, "flutter_hz": 4.0}),
        ("25", 16000, {"flutter": 0.03, "flutter_hz": 10.0}),
        ("29.97df", 48000, {"flutter": 0.01, "flutter_hz": 20.0}),
        ("24", 48000, {"wow": 0.04, "wow_hz": 1.0, "flutter": 0.01, "flutter_hz": 11.0}),
    ],
)
def test_the_first_word_of_a_fluttering_tape_is_read_where_the_recording_begins_with_it(
    rate: str, sample_rate: int, swing: dict[str, Any]
) -> None:
    channel = ChannelDistortion(seed=5, faults=AudioFaults(snr_db=25.0, seed=5), **swing)
    start = Timecode.from_frame_count(123_456, timecode_rate(rate))
    signal = play_ltc(start, 30, sample_rate, channel)
    samples = signal.samples[int(signal.starts[0]) :]
    expected = [str(label) for label in signal.labels]
    assert [str(reading.timecode) for reading in _live(samples, sample_rate)] == expected
    recorded = decode_recording(TimecodeConfig(), "tape", sample_rate, samples)
    assert [str(reading.timecode) for reading in recorded] == expected
