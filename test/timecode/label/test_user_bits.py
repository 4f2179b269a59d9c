"""User bits are reported when they are certain, and stay until words clearly say something else."""

from __future__ import annotations

import numpy as np

from panoptic_ros.timecode.label.user_bits import UserBits


def soft(value: int, nats: float) -> np.ndarray:
    return np.where((value >> np.arange(32)) & 1, nats, -nats).astype(float)


def test_unknown_until_certain() -> None:
    bits = UserBits(soft(0x12345678, 5.0))
    assert bits.value == 0 and not bits.certain
    bits.hear(soft(0x12345678, 5.0), 0.0, True)
    bits.hear(soft(0x12345678, 5.0), 0.0, True)
    assert bits.value == 0x12345678


def test_a_bit_that_a_click_turns_is_not_believed_but_a_change_is() -> None:
    bits = UserBits(soft(7, 20.0))
    bits.hear(soft(6, 20.0), 30.0, True)
    assert bits.value == 7
    bits.hear(soft(7, 20.0), 0.0, True)
    bits.hear(soft(6, 20.0), 30.0, False)
    assert bits.value == 7
    bits.hear(soft(0xFFFF0000, 20.0), 400.0, True)
    assert bits.value == 0xFFFF0000
    for _ in range(2):
        bits.hear(soft(0xFFFF0001, 20.0), 30.0, True)
    assert bits.value == 0xFFFF0001
