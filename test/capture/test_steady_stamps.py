"""Stamps of live sound: blocks that are told of late move nothing."""

import numpy as np
import pytest

from panoptic_ros.capture.sound.described import BlockStampFilter

SECOND, RATE, COUNT = 10**9, 48_000, 4800


def told(drift, late, begin=100 * SECOND):
    """True stamps of blocks of .1 s of a card whose clock drifts, and those that the device tells."""
    firsts = np.arange(len(late)) * COUNT
    true = begin + np.rint(firsts * SECOND / (RATE * (1.0 + drift))).astype(np.int64)
    return firsts.tolist(), true, (true + np.rint(late * SECOND).astype(np.int64)).tolist()


@pytest.mark.parametrize("drift", [-1e-4, 0.0, 1e-4])
def test_blocks_that_come_late_are_stamped_when_they_were_heard(drift):
    rng = np.random.default_rng(0)
    late = rng.uniform(0.0, 0.09, 600) * (rng.random(600) < 0.8)  # one of five is prompt
    firsts, true, stamps = told(drift, late)
    steady = BlockStampFilter(RATE)
    found = np.array([steady.stamp(f, s) for f, s in zip(firsts, stamps)])
    assert np.abs(found - true)[30:].max() < 0.001 * SECOND and (np.diff(found) > 0).all()


def test_a_few_blocks_that_are_stamped_too_early_move_nothing_or_are_forgotten():
    firsts, true, stamps = told(0.0, np.zeros(150))
    for k in (3, 40, 70, 100):
        stamps[k] -= SECOND // 20
    steady = BlockStampFilter(RATE)
    beside = np.array([steady.stamp(f, s) for f, s in zip(firsts, stamps)]) - true
    assert (beside[:3] == 0).all() and (beside[3:] >= -SECOND // 20).all()
    assert (beside[20:] == 0).all()


def test_after_a_loss_the_count_tells_nothing_of_before():
    steady = BlockStampFilter(RATE)
    assert steady.stamp(0, 5 * SECOND) == 5 * SECOND
    assert steady.stamp(COUNT, 5 * SECOND + SECOND // 5) < 5 * SECOND + SECOND // 9  # late
    steady.restart()
    assert steady.stamp(2 * COUNT, 6 * SECOND) == 6 * SECOND
    assert steady.stamp(3 * COUNT, 9 * SECOND) == 9 * SECOND  # the machine slept
    assert steady.stamp(4 * COUNT, 8 * SECOND) == 9 * SECOND + 1  # never back
