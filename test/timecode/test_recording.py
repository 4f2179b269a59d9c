"""The offline form: stamps and labels of whole recordings."""

from __future__ import annotations

import numpy as np

from panoptic_ros.domain import Timecode
from panoptic_ros.simulation.ltc_channel import ChannelDistortion, play_ltc
from panoptic_ros.simulation.ltc_signal import AudioFaults, timecode_rate
from panoptic_ros.timecode.config import TimecodeConfig
from panoptic_ros.timecode.recording import decode_recording


def test_a_coupling_delays_all_words_alike() -> None:
    channel = ChannelDistortion(high_pass_hz=300.0, faults=AudioFaults(snr_db=40.0))
    signal = play_ltc(Timecode(1, 2, 3, 4, timecode_rate("30")), 90, 48000, channel)
    readings = decode_recording(TimecodeConfig(), "tape", 48000, signal.samples, stamp_ns=10**9)
    assert [reading.timecode for reading in readings] == list(signal.labels)
    errors = np.array([r.start_sample for r in readings]) - signal.starts
    assert np.std(errors) * 1e6 / 48000 < 5.0
    assert abs(errors.mean()) * 1e6 / 48000 < 15.0  # the filter moves zero crossings by some 10 us
    assert readings[0].stamp_ns == 10**9 + round(readings[0].start_sample / 48000 * 1e9)


def test_two_signals_and_nothing() -> None:
    first, second = (
        play_ltc(Timecode(hour, 0, 0, 0, timecode_rate("25")), 30, 16000, ChannelDistortion())
        for hour in (1, 5)
    )
    joined = np.concatenate([first.samples, np.zeros(16000, np.float32), second.samples])
    labels = [r.timecode for r in decode_recording(TimecodeConfig(), "x", 16000, joined)]
    assert labels == [*first.labels, *second.labels]
    assert decode_recording(TimecodeConfig(), "x", 16000, np.zeros(16000, np.float32)) == []
