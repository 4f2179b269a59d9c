"""The bits that a label fixes are those that are sent."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from panoptic_ros.domain import Timecode
from panoptic_ros.simulation.ltc_signal import (
    timecode_rate,
    word_bits,
)
from panoptic_ros.timecode.word.layout import FREE, USER_BITS, USER_WEIGHTS, known_bits


@settings(max_examples=100, deadline=None)
@given(
    st.integers(0, 2_073_599),
    st.sampled_from(["23.976", "24", "25", "29.97", "29.97df", "30"]),
    st.integers(0, 2**32 - 1),
    st.booleans(),
)
def test_known_bits_are_those_that_are_sent(count: int, rate: str, user: int, balanced: bool) -> None:
    label = Timecode.from_frame_count(count, timecode_rate(rate))
    sent, known = np.array(word_bits(label, user, balanced)), known_bits(label)
    fixed = known != FREE
    assert fixed.sum() == 26 + 1 + 16  # digits, drop-frame, sync
    assert (known[fixed] == sent[fixed]).all()
    assert int(USER_WEIGHTS @ sent[USER_BITS]) == user
