"""The most likely bits, against brute force."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoptic_ros.timecode.word.viterbi import FREE, best_path, soft_bits


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
