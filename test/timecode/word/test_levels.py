"""Levels of a word, and what the sync word before it says of its polarity."""

from __future__ import annotations

import numpy as np
import pytest

from panoptic_ros.domain import Timecode
from panoptic_ros.simulation.ltc_signal import encode_ltc, timecode_rate
from panoptic_ros.timecode.signal.grid import Grid
from panoptic_ros.timecode.word.levels import WordLevels, word_levels

CELL = 20.0


def heard(word: int, reverse: bool, cut: bool = False) -> WordLevels:
    """Of the first or second of two words; cut: without what comes before it in the order of sending."""
    start = Timecode.from_frame_count(777, timecode_rate("30"))
    signal = encode_ltc(start, 2, 48000, lead=50.0, tail=2000, amplitude=1.0, reverse=reverse)
    samples = signal.samples.astype(float)
    middle = 50.0 + CELL * (40.0 + 80.0 * word)
    if cut:
        samples[slice(int(middle + 40 * CELL), None) if reverse else slice(0, int(middle - 40 * CELL))] = 0.0
    sums = np.concatenate([[0.0], np.cumsum(samples)])
    return word_levels(sums, Grid(middle, CELL), reverse)


@pytest.mark.parametrize("reverse", [False, True])
def test_the_sync_word_before_tells_the_sign_of_the_first_half_cell(reverse: bool) -> None:
    levels = heard(0 if reverse else 1, reverse)
    assert levels.halves.shape == (160,)
    assert np.sign(levels.before) == np.sign(levels.halves[0])
    assert abs(levels.before) == pytest.approx(32 * np.abs(levels.halves).mean(), rel=0.05)


@pytest.mark.parametrize("reverse", [False, True])
def test_silence_says_hardly_anything(reverse: bool) -> None:
    assert abs(heard(1 if reverse else 0, reverse).before) < 1.0
    assert abs(heard(0 if reverse else 1, reverse, cut=True).before) < 1.0
