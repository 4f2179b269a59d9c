"""Global shutters among rolling ones, and the doubt about them."""

import numpy as np
import pytest

from panoptic_ros.continuous.shutters import LONGEST_LINE_S, fastest_shutter, global_shutters, line_doubts

US = 1e-6
TRUSTED = np.array([True, False, False, False])
NONE = np.zeros(4, bool)


def doubts(lines, deviations, found, fastest):
    """Standard deviations (us) that decisions add to line delays, without a gradient at the values."""
    variances = (US * np.asarray(deviations)) ** 2
    whole = np.diag(np.concatenate([np.ones(8), variances]))
    added = line_doubts(US * np.asarray(lines), whole, np.zeros(12), found, fastest)
    return np.sqrt(np.diag(added)[8:]) / US


def test_delays_that_may_be_zero_are_zero():
    lines = US * np.array([0.0, 0.4, 20.0, 3.0])
    found = global_shutters(lines, np.diag((US * np.array([0.0, 0.5, 0.5, 0.5])) ** 2), TRUSTED)
    assert found.tolist() == [False, True, False, False]
    assert fastest_shutter(lines).tolist() == [True, False, False, False]


def test_a_clear_decision_leaves_no_doubt():
    added = doubts([0.0, 0.0, 20.0, 25.0], [0.0, 0.2, 0.2, 0.2], np.array([False, True, False, False]), NONE)
    assert added[1] < 0.05 and added[2] == added[3] == 0.0


def test_an_unclear_decision_is_not_certain():
    added = doubts([0.0, 0.0, 20.0, 25.0], [0.0, 10.0, 0.2, 0.2], np.array([False, True, False, False]), NONE)
    assert 5.0 < added[1] < 10.0 and added[2] == added[3] == 0.0


def test_the_fastest_of_rolling_shutters_is_a_guess():
    fastest = np.array([True, False, False, False])
    alone = doubts([0.0, 5.0, 8.0, 12.0], [9.0, 0.2, 0.2, 0.2], NONE, fastest)
    room = 1e6 * LONGEST_LINE_S - 12.0
    assert alone[0] == pytest.approx(room / 3.0**0.5 * (room / (room + 40.0)) ** 0.5)
    two = doubts([0.0, 0.0, 8.0, 12.0], [9.0, 0.2, 0.2, 0.2], np.array([False, True, False, False]), fastest)
    assert two[0] < 0.15 * alone[0]
