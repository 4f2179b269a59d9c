"""Half cells are followed through flutter, from both sides."""

from __future__ import annotations

import numpy as np

from panoptic_ros.domain import Timecode
from panoptic_ros.simulation.ltc_channel import ChannelDistortion, play_ltc
from panoptic_ros.simulation.ltc_signal import AudioFaults, LtcSignal, timecode_rate
from panoptic_ros.timecode.word.tracking import BEFORE, TICKS, track, word_ticks

CELL = 20.0


def _signal() -> LtcSignal:
    channel = ChannelDistortion(
        flutter=0.005, flutter_hz=15.0, seed=7, faults=AudioFaults(snr_db=18.0, seed=7)
    )
    return play_ltc(Timecode(1, 2, 3, 4, timecode_rate("30")), 12, 48000, channel, lead=0.1)


def test_ticks_stay_with_the_edges_in_both_directions() -> None:
    signal = _signal()
    sums = np.concatenate([[0.0], np.cumsum(signal.samples.astype(float))])
    there = track(sums, signal.starts[1], CELL, 9 * TICKS, 0.25)
    back = track(sums, signal.starts[10], -CELL, 9 * TICKS, 0.25)[::-1]
    for ticks in (there, back):
        away = ticks[::TICKS] - signal.starts[1:11]
        assert np.abs(away).max() < 0.1 * CELL


def test_silence_moves_no_ticks() -> None:
    noise = 1e-3 * np.random.default_rng(1).standard_normal(4000)
    sums = np.concatenate([[0.0], np.cumsum(noise)])
    ticks = track(sums, 100.0, CELL, 300, 0.25)
    np.testing.assert_allclose(ticks, 100.0 + 0.5 * CELL * np.arange(301), atol=0.1 * CELL)


def test_ticks_of_a_word_and_the_sync_word_sent_before_it() -> None:
    ticks = 5.0 + 10.0 * np.arange(3 * TICKS)
    forward, reverse = word_ticks(ticks, TICKS, False), word_ticks(ticks, TICKS, True)
    assert forward is not None and reverse is not None
    np.testing.assert_array_equal(forward, ticks[TICKS - BEFORE : 2 * TICKS + 1])
    np.testing.assert_array_equal(reverse, ticks[TICKS : 2 * TICKS + BEFORE + 1])
    first, last = word_ticks(ticks, 3, False), word_ticks(ticks, 2 * TICKS - 4, True)
    assert first is not None and last is not None
    np.testing.assert_allclose(np.diff(first), 10.0)
    np.testing.assert_allclose(np.diff(last), 10.0)
    assert len(first) == len(last) == TICKS + BEFORE + 1
    assert word_ticks(ticks, -1, False) is None and word_ticks(ticks, 2 * TICKS, False) is None
