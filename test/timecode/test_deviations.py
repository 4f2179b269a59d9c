"""Stated deviations say what errors are, also where the signal is not as a fit supposes."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from panoptic_ros.domain import Timecode
from panoptic_ros.simulation.ltc_channel import Channel, play_ltc
from panoptic_ros.simulation.ltc_signal import AudioFaults, timecode_rate
from panoptic_ros.timecode import TimecodeConfig, decode_recording
from panoptic_ros.timecode.fit_kernels import misfit, train_rows

START = Timecode(10, 20, 30, 4, timecode_rate("30"))


@pytest.mark.parametrize(
    ("channel", "faults", "most_us"),
    [
        ({}, {"snr_db": 50.0}, 0.01),
        ({}, {"snr_db": 10.0}, 0.6),
        ({}, {"snr_db": 50.0, "gain_db": 10.0}, 0.03),
        ({}, {"snr_db": 50.0, "hum_db": 0.0}, 0.02),
        ({"high_pass_hz": 1000.0}, {"snr_db": 50.0}, 0.02),
        ({"clip": 0.5}, {"snr_db": 50.0}, 0.5),
        ({"jitter_s": 5e-6}, {"snr_db": 50.0}, 0.7),
    ],
)
def test_deviations_are_honest(channel: dict[str, Any], faults: dict[str, Any], most_us: float) -> None:
    errors, stds = [], []
    for seed in (31, 32):
        way = Channel(speed=1.00003, seed=seed, faults=AudioFaults(seed=seed, **faults), **channel)
        signal = play_ltc(START, 120, 48000, way, lead=0.5 + 7e-6 * seed)
        readings = decode_recording(TimecodeConfig(), "line", 48000, signal.samples)
        assert [reading.timecode for reading in readings] == list(signal.labels)
        error = np.array([reading.start_sample for reading in readings]) - signal.starts
        errors.append(error - error.mean())
        stds.append([reading.std_samples for reading in readings])
    assert np.std(errors) * 1e6 / 48000 < most_us
    assert 0.6 < np.sqrt(np.mean(np.square(np.array(errors) / stds))) < 2.0


def test_a_delay_in_a_high_pass_is_taken_away() -> None:
    way = Channel(speed=1.00003, high_pass_hz=1000.0, faults=AudioFaults(snr_db=50.0))
    signal = play_ltc(START, 120, 48000, way)
    readings = decode_recording(TimecodeConfig(), "line", 48000, signal.samples)
    errors = np.array([reading.start_sample for reading in readings]) - signal.starts
    assert abs(errors.mean()) * 1e6 / 48000 < 0.3


def test_misfit_is_seen_in_wrong_shapes_only() -> None:
    rng = np.random.default_rng(3)
    grid, places = np.array([400.3, 20.0, 0.0]), np.flatnonzero(rng.integers(0, 3, 36)) - 18.0
    at = np.arange(-4, 4) + np.arange(9)[:, None] / 8.0
    steep = np.stack([np.zeros_like(at), np.exp(-(at**2))])
    rows = train_rows(0, np.zeros(800), grid, places, steep, 4)
    noise = 0.1 * rng.standard_normal(800)
    wrong = noise + 0.2 * rows[0] * (np.abs(rows[2]) > 0.5)
    assert misfit(0, rows, noise, grid, places) < 0.05**2
    assert misfit(0, rows, wrong, grid, places) > 0.05**2
