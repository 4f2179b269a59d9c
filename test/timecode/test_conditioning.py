"""The filter before decoding: what it lets pass stays where it is, what it does not is gone."""
from __future__ import annotations

import numpy as np
import pytest

from panoptic_ros.timecode.conditioning import Conditioner

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
