"""Channels that move edges move the truth with them; filters that do not, do not."""

from __future__ import annotations

import numpy as np
import pytest

from panoptic_ros.domain import Timecode
from panoptic_ros.errors import UsageError
from panoptic_ros.simulation.ltc_channel import ChannelDistortion, play_ltc
from panoptic_ros.simulation.ltc_signal import AudioFaults, LtcSignal, timecode_rate

START = Timecode(1, 2, 3, 4, timecode_rate("25"))


def crossings(signal: LtcSignal) -> np.ndarray:
    x = signal.samples.astype(float)
    at = np.flatnonzero(x[:-1] * x[1:] < 0)
    return at + x[at] / (x[at] - x[at + 1])


@pytest.mark.parametrize(
    ("channel", "within"),
    [
        (ChannelDistortion(), 0.05),
        (ChannelDistortion(speed=0.8), 0.05),
        (ChannelDistortion(ramp=0.3), 0.05),
        (ChannelDistortion(wow=0.03, wow_hz=3.0), 0.05),
        (ChannelDistortion(inverted=True), 0.05),
        (ChannelDistortion(low_pass_hz=4000.0), 1.5),
        (ChannelDistortion(clip=0.5), 0.2),
    ],
)
def test_words_start_with_an_edge(channel: ChannelDistortion, within: float) -> None:
    signal = play_ltc(START, 20, 48000, channel, lead=0.1001)
    found = crossings(signal)
    distance = np.abs(found[:, None] - signal.starts[1:]).min(axis=0)
    assert distance.max() < within
    assert [str(label) for label in signal.labels[:2]] == ["01:02:03:04", "01:02:03:05"]


def test_speed_changes_as_asked_for() -> None:
    signal = play_ltc(START, 125, 16000, ChannelDistortion(ramp=0.3))
    lengths = np.diff(signal.starts)
    assert lengths.max() / lengths.min() == pytest.approx(1.15 / 0.85, rel=0.01)
    still = np.diff(play_ltc(START, 50, 16000, ChannelDistortion(speed=1.25)).starts)
    np.testing.assert_allclose(still, 16000 / 25 / 1.25)


def test_backwards_the_first_edge_comes_last() -> None:
    signal = play_ltc(START, 3, 48000, ChannelDistortion(), lead=0.1, reverse=True)
    np.testing.assert_allclose(signal.starts, 4800 + 1920 * np.arange(1, 4))
    assert str(signal.labels[1]) == "01:02:03:03"


def test_echoes_coupling_and_noise() -> None:
    clean = play_ltc(START, 10, 16000, ChannelDistortion()).samples
    echoes = play_ltc(START, 10, 16000, ChannelDistortion(echo_s=0.2, direct_db=6.0)).samples - clean
    assert np.std(echoes) / np.std(clean) == pytest.approx(0.5, rel=0.3)
    drooping = play_ltc(START, 10, 16000, ChannelDistortion(high_pass_hz=500.0)).samples
    assert abs(drooping.mean()) < 1e-4 and np.std(drooping) < np.std(clean)
    noisy = play_ltc(START, 10, 16000, ChannelDistortion(faults=AudioFaults(snr_db=0.0))).samples
    assert np.std(noisy) > 1.3 * np.std(clean)
    shaken = play_ltc(START, 10, 48000, ChannelDistortion(jitter_s=2e-5, seed=3))
    assert np.abs(crossings(shaken)[:, None] - shaken.starts[1:]).min(axis=0).max() > 0.3


def test_nothing_to_play() -> None:
    with pytest.raises(UsageError, match="cannot play 0 words"):
        play_ltc(START, 0, 48000, ChannelDistortion())
