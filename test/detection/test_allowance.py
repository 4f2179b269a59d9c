"""Looks never come in bursts, whatever was left out before, and nobody waits for ever."""

import numpy as np
import pytest

from panoptic_ros.detection.allowance import SCAN, Allowance

SECOND = 10**9
NAMES = [f"cam{k}" for k in range(8)]
PERIOD = SECOND // 20
LOOKS = 5.0


def granted(allowance, instants, wanted, names=NAMES):
    """Who may look (instants, cameras); wanted(k, camera index) says whether one is due."""
    return np.array(
        [
            [allowance.takes(name, k * PERIOD, k, LOOKS, wanted(k, i)) for i, name in enumerate(names)]
            for k in instants
        ]
    )


def test_cameras_that_look_in_turn_are_never_put_off():
    due = lambda k, i: (k + i // 2) % 4 == 0  # noqa: E731
    found = granted(Allowance(8), range(60), due)
    wanted = [[due(k, i) for i in range(8)] for k in range(60)]
    np.testing.assert_array_equal(found[2:], wanted[2:])


@pytest.mark.parametrize("step", [1, 3, 5])
def test_as_many_looks_with_every_instant_however_many_were_left_out(step):
    found = granted(Allowance(8), range(0, 80 * step, step), lambda k, i: True)
    assert abs(found[4:].sum() / len(found[4:]) - 8 * LOOKS / 20) < 0.1
    assert found[1:].sum(axis=1).max() <= 3


def test_all_who_wait_come_in_turn():
    found = granted(Allowance(8), range(80), lambda k, i: True)[4:]
    gaps = [np.diff(np.flatnonzero(column)).max() for column in found.T]
    assert max(gaps) <= 5 and np.ptp(found.sum(axis=0)) <= 1


def test_scans_count_as_well():
    allowance, looks = Allowance(8), 0
    for k in range(80):
        looks += granted(allowance, [k], lambda k, i: True).sum()
        allowance.scanned()
    assert abs(looks / 80 - (8 * LOOKS / 20 - SCAN)) < 0.1


def test_who_was_put_off_looks_later_without_asking_again():
    allowance = Allowance(8)
    granted(allowance, range(1), lambda k, i: True)
    found = granted(allowance, range(1, 8), lambda k, i: False)
    assert found.sum() == 8 - granted(Allowance(8), range(1), lambda k, i: True).sum()


def test_a_camera_that_died_while_it_waited_holds_up_nobody_for_long():
    allowance = Allowance(8)
    granted(allowance, range(6), lambda k, i: True)
    found = granted(allowance, range(6, 60), lambda k, i: True, NAMES[:4])
    assert found[8:].sum() >= 0.9 * len(found[8:])


def test_every_image_may_be_looked_at_where_there_is_a_look_for_each():
    allowance = Allowance(8)
    assert all(allowance.takes("cam0", k * PERIOD, k, 0.0, True) for k in range(9))
    allowance = Allowance(8)
    granted(allowance, range(2), lambda k, i: False)
    assert all(allowance.takes(n, k * PERIOD, k, 20.0, True) for k in range(2, 9) for n in NAMES)
