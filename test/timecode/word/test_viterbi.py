"""The most likely bits, against brute force."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoptic_ros.domain import Timecode
from panoptic_ros.simulation.ltc_signal import encode_ltc, timecode_rate
from panoptic_ros.timecode.signal.half_cells import CellGrid
from panoptic_ros.timecode.word.layout import FREE
from panoptic_ros.timecode.word.viterbi import WordLevels, best_path, soft_bits, word_levels

CELL = 20.0


def wave(bits: tuple[int, ...], sign: int) -> list[int]:
    halves = []
    for bit in bits:
        halves += [sign, -sign] if bit else [sign, sign]
        sign = sign if bit else -sign
    return halves


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.floats(-1.0, 1.0), min_size=12, max_size=12),
    st.lists(st.sampled_from([0, 1, FREE]), min_size=6, max_size=6),
    st.sampled_from([0.0, -3.0, 0.5]),
)
def test_paths_and_soft_bits_are_the_most_likely_ones(
    levels: list[float], wanted: list[int], before: float
) -> None:
    """Brute force over all words of six bits and both polarities."""
    halves, given_bits = np.array(levels), np.array(wanted, np.int8)
    scores: dict[tuple[int, ...], float] = {}
    for bits in itertools.product((0, 1), repeat=6):
        if all(want in (FREE, bit) for want, bit in zip(wanted, bits)):
            scores[bits] = max(float(np.dot(levels, wave(bits, sign))) + sign * before for sign in (1, -1))
    score, found, signs = best_path(halves, given_bits, before)
    assert score == pytest.approx(max(scores.values()), abs=1e-9)
    assert scores[tuple(found)] == pytest.approx(score, abs=1e-9)
    assert list(signs) in [wave(tuple(found), sign) for sign in (1, -1)]
    soft = soft_bits(halves, given_bits, before)
    for k in np.flatnonzero(given_bits == FREE):
        one, zero = (max(s for bits, s in scores.items() if bits[k] == value) for value in (1, 0))
        assert soft[k] == pytest.approx(one - zero, abs=1e-9)


# ---- levels of a word, and what the sync word before it says of its polarity


def heard(word: int, reverse: bool, cut: bool = False) -> WordLevels:
    """Of the first or second of two words; cut: without what comes before it in the order of sending."""
    start = Timecode.from_frame_count(777, timecode_rate("30"))
    signal = encode_ltc(start, 2, 48000, lead=50.0, tail=2000, amplitude=1.0, reverse=reverse)
    samples = signal.samples.astype(float)
    middle = 50.0 + CELL * (40.0 + 80.0 * word)
    if cut:
        samples[slice(int(middle + 40 * CELL), None) if reverse else slice(0, int(middle - 40 * CELL))] = 0.0
    sums = np.concatenate([[0.0], np.cumsum(samples)])
    return word_levels(sums, CellGrid(middle, CELL), reverse)


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
