"""Stated deviations say what errors are, also where the signal is not as a fit supposes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from panoptic_ros.domain import Timecode
from panoptic_ros.simulation.ltc_channel import ChannelDistortion, play_ltc
from panoptic_ros.simulation.ltc_signal import AudioFaults, timecode_rate
from panoptic_ros.timecode.config import TimecodeConfig
from panoptic_ros.timecode.decoder import LtcDecoder
from panoptic_ros.timecode.recording import decode_recording

START = Timecode(10, 20, 30, 4, timecode_rate("30"))


@pytest.mark.parametrize(
    ("channel", "faults", "most_us", "least_ratio"),
    [  # what filters do to edges counts as scatter, so deviations on clean lines are larger than errors
        ({}, {"snr_db": 50.0}, 0.2, 0.0),
        ({}, {"snr_db": 30.0}, 0.3, 0.0),
        ({}, {"snr_db": 10.0}, 1.4, 0.7),
        ({}, {"snr_db": 50.0, "gain_db": 10.0}, 0.3, 0.0),
        ({}, {"snr_db": 50.0, "hum_db": 0.0}, 0.3, 0.0),
        ({"high_pass_hz": 1000.0}, {"snr_db": 50.0}, 6.0, 0.0),
        ({"clip": 0.5}, {"snr_db": 50.0}, 0.5, 0.0),
        ({"clip": 0.8}, {"snr_db": 50.0}, 0.5, 0.0),
        ({"low_pass_hz": 3000.0}, {"snr_db": 50.0}, 0.8, 0.0),
        ({"jitter_s": 5e-6}, {"snr_db": 50.0}, 1.4, 0.7),
    ],
)
def test_deviations_are_honest(
    channel: dict[str, Any], faults: dict[str, Any], most_us: float, least_ratio: float
) -> None:
    errors, stds = [], []
    for seed in (31, 32):
        way = ChannelDistortion(speed=1.00003, seed=seed, faults=AudioFaults(seed=seed, **faults), **channel)
        signal = play_ltc(START, 120, 48000, way, lead=0.5 + 7e-6 * seed)
        readings = decode_recording(TimecodeConfig(), "line", 48000, signal.samples)
        assert [reading.timecode for reading in readings] == list(signal.labels)
        error = np.array([reading.start_sample for reading in readings]) - signal.starts
        errors.append(error - error.mean())
        stds.append([reading.std_samples for reading in readings])
    assert np.std(errors) * 1e6 / 48000 < most_us
    assert least_ratio <= np.sqrt(np.mean(np.square(np.array(errors) / stds))) < 1.5
    assert np.median(stds) < 1.5e-6 * 48000 * max(1.0, most_us)


def test_a_high_pass_delays_all_words_alike() -> None:
    way = ChannelDistortion(speed=1.00003, high_pass_hz=1000.0, faults=AudioFaults(snr_db=50.0))
    signal = play_ltc(START, 120, 48000, way)
    readings = decode_recording(TimecodeConfig(), "line", 48000, signal.samples)
    errors = np.array([reading.start_sample for reading in readings]) - signal.starts
    assert abs(errors.mean()) * 1e6 / 48000 < 50.0  # clock models tolerate 200 us
    assert errors.std() * 1e6 / 48000 < 6.0


def test_words_do_not_stick_to_the_places_of_samples() -> None:
    """With a slow drift, words teach the shape of an unknown filter at the same places between samples."""
    way = ChannelDistortion(speed=1.000005, faults=AudioFaults(snr_db=50.0, seed=4))
    signal = play_ltc(START, 100, 48000, way, user_bits=0x26110721)
    numerator, denominator = butter(2, 1000.0, "high", fs=48000)
    decoder = LtcDecoder(TimecodeConfig(), 48000)
    words = decoder.push(lfilter(numerator, denominator, signal.samples)) + decoder.finish()
    errors = np.array([word.start for word in words]) - signal.starts
    assert np.ptp(errors[1:]) * 1e6 / 48000 < 12.0
