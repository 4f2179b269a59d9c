"""The filter before decoding: what it lets pass stays where it is, what it does not is gone."""

from __future__ import annotations

import numpy as np
import pytest

from panoptic_ros.domain import Timecode
from panoptic_ros.simulation.ltc_signal import (
    AudioFaults,
    degrade_audio,
    encode_ltc,
    timecode_rate,
)
from panoptic_ros.timecode.signal.conditioning import Conditioner, hat_sums

Array = np.ndarray


def conditioned(signal: Array, rate: int) -> tuple[Array, Array]:
    """Of a signal that comes in uneven parts; its times in seconds."""
    conditioner = Conditioner(rate, 350.0)
    parts = [conditioner.push(part) for part in np.split(signal, [7, rate // 9, rate // 3])]
    out = np.concatenate([*parts, conditioner.push(np.zeros(conditioner.reach))])
    assert len(out) == len(signal) * conditioner.up
    return out, np.arange(len(out)) / (rate * conditioner.up)


@pytest.mark.parametrize("rate", [8000, 11025, 16000, 22050, 44100, 48000, 96000])
def test_tones_of_timecode_pass_and_hum_does_not(rate: int) -> None:
    time = np.arange(rate) / rate
    tone = np.sin(2.0 * np.pi * 1200.0 * time)
    for slow in (np.full(rate, 0.5), 0.5 * np.sin(2.0 * np.pi * 50.0 * time)):
        out, at = conditioned(tone + slow, rate)
        inner = (at > 0.1) & (at < 0.9)
        assert np.abs(out - np.sin(2.0 * np.pi * 1200.0 * at))[inner].max() < 7e-3


def test_conditioning_removes_hum_and_keeps_edges_in_place() -> None:
    signal = encode_ltc(Timecode.from_frame_count(777, timecode_rate("25")), 10, 48000).samples
    bad = degrade_audio(signal, 48000, AudioFaults(hum_db=6.0, dc=0.3, clicks_per_s=20.0))
    conditioner = Conditioner(48000, 350.0)
    parts = [conditioner.push(part.astype(float)) for part in np.array_split(bad, 7)]
    clean = np.concatenate([*parts, conditioner.push(np.zeros(conditioner.reach))])
    assert len(clean) == len(signal)
    inner = slice(2000, -2000)
    assert np.corrcoef(clean[inner], signal[inner])[0, 1] > 0.95
    assert np.abs(clean).max() < 0.7


@pytest.mark.parametrize(("count", "step"), [(1640, 8), (547, 2), (273, 1)])
def test_sums_of_hats_are_those_of_a_dense_matrix(count: int, step: int) -> None:
    rows = np.random.default_rng(1).normal(size=(4, count))
    knots = step * np.arange((count - 1) // step + 2)
    hats = np.array([np.interp(np.arange(count), knots, row) for row in np.eye(len(knots))])
    np.testing.assert_allclose(hat_sums(rows, step), rows @ hats.T, atol=1e-9)
