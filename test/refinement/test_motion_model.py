"""Transitions against integration in small steps, and what they become at the ends of their range."""

import numpy as np
import pytest

from panoptic_ros.refinement.motion_model import density, lasting_variance, transition
from panoptic_ros.refinement.records import MotionStates, padded, unknown, widened


@pytest.mark.parametrize("memory", [0.01, 0.05, 1.0])
def test_a_transition_is_that_of_many_small_ones(memory):
    whole, small = transition(0.2, memory), transition(0.0002, memory)
    forward, spread = np.eye(3), np.zeros((3, 3))
    for _ in range(1000):
        forward, spread = small.forward @ forward, small.forward @ spread @ small.forward.T + small.spread
    assert whole.forward == pytest.approx(forward, rel=1e-6, abs=1e-9)
    assert whole.spread == pytest.approx(spread, rel=1e-4)


def test_accelerations_that_hardly_last_are_white():
    white, short = transition(0.04, 0.0), transition(0.04, 1e-5)
    assert short.forward[:2, :2] == pytest.approx(white.forward, rel=1e-3)
    assert short.spread[:2, :2] == pytest.approx(white.spread, rel=2e-3)
    assert density(0.0) == 1.0 and not lasting_variance(np.ones(3), 0.0).any()


def test_accelerations_stay_as_large_as_they_are():
    step = transition(0.04, 0.1)
    variance = lasting_variance(np.array([3.0]), 0.1)[0]
    later = step.forward[2, 2] ** 2 * variance + 3.0 * step.spread[2, 2]
    assert later == pytest.approx(variance)


def test_a_moment_is_widened_by_what_is_known_to_be_zero():
    moment = unknown(5, 0.1, 2, 4)
    moment.motion.states[...], moment.gains[...] = 1.0, 2.0
    wide = widened(moment, 9)
    assert wide.motion.states.shape == (2, 4, 9) and wide.gains.shape == (2, 4, 9, 9)
    assert (wide.motion.states[..., :6] == 1.0).all() and not wide.motion.states[..., 6:].any()
    assert (wide.gains[..., :6, :6] == 2.0).all() and wide.gains.sum() == moment.gains.sum()
    one = MotionStates(np.ones((4, 6)), np.ones((4, 6, 6)))
    assert padded(one, 9).covariances.sum() == one.covariances.sum()
