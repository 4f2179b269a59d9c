"""Looks go round the rig by stamps alone; strangers raise alarms, and posters soon do not."""

import numpy as np
import pytest

from panoptic_ros.detection.allowance import Allowance
from panoptic_ros.detection.looking import (
    FIRST_WAIT_NS,
    WHOLE_IMAGES,
    CameraSchedule,
    DetectionMode,
    DetectionScheduler,
)

NAMES = tuple(f"cam{k}" for k in range(6))
PERIOD = 40_000_000
BOX = np.array([[100.0, 100.0, 150.0, 250.0]])


def looks(lookout, frames, nobody=False, start=0, names=NAMES):
    """What is done (frames, cameras), and which of them are scanned."""
    found = [[lookout.look(name, start + k * PERIOD, nobody) for name in names] for k in range(frames)]
    return np.array([[what.value for what, _ in row] for row in found]), np.array(
        [[scan for _, scan in row] for row in found]
    )


def test_every_image_is_looked_at_without_a_rate():
    what, _ = looks(DetectionScheduler(NAMES, 0.0, True), 9)
    assert (what == "regions").all()


@pytest.mark.parametrize("period", [2, 3, 4])
def test_cameras_look_in_turn_and_as_often_as_asked(period):
    what, _ = looks(DetectionScheduler(NAMES, 25.0 / period, True), 60)
    due = what[1:] == "regions"
    assert set(what[1:].ravel()) == {"regions", "carry"}
    assert abs(due.mean() - 1 / period) < 0.02
    per_instant = due.sum(axis=1)
    assert per_instant.max() - per_instant.min() <= 1 + (6 % period > 0)
    gaps = [np.diff(np.flatnonzero(column)).max() for column in due.T]
    assert max(gaps) <= period + 1


def test_the_order_of_arrival_does_not_matter():
    one, other = DetectionScheduler(NAMES, 8.0, True), DetectionScheduler(NAMES, 8.0, True)
    straight, scans = looks(one, 30)
    back, again = looks(other, 30, names=NAMES[::-1])
    np.testing.assert_array_equal(straight, back[:, ::-1])
    np.testing.assert_array_equal(scans, again[:, ::-1])


def test_whole_images_are_looked_at_while_nobody_is_known_and_without_guidance():
    for lookout, nobody in (
        (DetectionScheduler(NAMES, 8.0, True), True),
        (DetectionScheduler(NAMES, 8.0, False), False),
    ):
        what, scans = looks(lookout, 30, nobody)
        assert set(what.ravel()) == {"whole", "carry"} and not scans.any()


def test_a_pause_or_a_clock_that_goes_back_makes_a_camera_look():
    lookout = DetectionScheduler(NAMES, 1.0, True)
    looks(lookout, 3)
    assert lookout.look("cam2", 20 * PERIOD, False)[0] is DetectionMode.REGIONS
    assert lookout.look("cam2", 5 * PERIOD, False)[0] is DetectionMode.REGIONS
    assert lookout.look("cam2", 6 * PERIOD, False)[0] is DetectionMode.CARRY


def test_scans_come_to_every_camera_equally_often():
    _, scans = looks(DetectionScheduler(NAMES, 8.0, True), 251)
    assert scans.sum() == pytest.approx(120, abs=6) and np.ptp(scans.sum(axis=0)) <= 1


def test_cameras_that_see_a_door_are_scanned_twice_as_often():
    lookout = DetectionScheduler(NAMES, 8.0, True)
    scans = [[lookout.look(name, k * PERIOD, False, name == "cam2")[1] for name in NAMES] for k in range(251)]
    counts = np.sum(scans, axis=0)
    assert counts[2] == pytest.approx(40, abs=2) and counts[0] == pytest.approx(20, abs=2)


def test_an_alarm_makes_all_cameras_look_at_whole_images_later_than_it():
    lookout = DetectionScheduler(NAMES, 8.0, True)
    looks(lookout, 3)
    assert lookout.raise_alarm("cam1", BOX, 3 * PERIOD)
    assert lookout.look("cam4", 3 * PERIOD, False)[0] is not DetectionMode.WHOLE  # of the same instant
    what, _ = looks(lookout, WHOLE_IMAGES + 2, start=4 * PERIOD)
    assert (what[:WHOLE_IMAGES] == "whole").all() and (what[WHOLE_IMAGES:] != "whole").all()


def test_somebody_who_stays_unexplained_is_minded_more_and_more_seldom():
    lookout, heard = DetectionScheduler(NAMES, 8.0, True), []
    for k in range(400):
        if lookout.raise_alarm("cam1", BOX + 0.1 * (k % 5), k * PERIOD):
            heard.append(k * PERIOD)
    waits = np.diff(heard)
    assert waits[0] >= FIRST_WAIT_NS and (waits[1:] >= 1.9 * waits[:-1]).all() and 4 <= len(heard) <= 7


def test_others_are_heard_while_a_poster_is_not():
    lookout = DetectionScheduler(NAMES, 8.0, True)
    assert lookout.raise_alarm("cam1", BOX, PERIOD)
    assert not lookout.raise_alarm("cam1", BOX, 2 * PERIOD)
    assert lookout.raise_alarm("cam1", BOX + 100.0, 2 * PERIOD)
    assert lookout.raise_alarm("cam2", BOX, 2 * PERIOD)


def test_live_an_alarm_is_answered_in_turns_before_the_next_is_heard():
    lookout = DetectionScheduler(NAMES, 8.0, True, Allowance(len(NAMES)))

    def instant(k):
        wishes = [(name, lookout.look(name, k * PERIOD, False)[0]) for name in NAMES]
        return [lookout.allowed(name, k * PERIOD, k, wish) for name, wish in wishes]

    for k in range(6):
        instant(k)
    assert lookout.raise_alarm("cam1", BOX, 6 * PERIOD)
    found = np.array([[look.value for look in instant(k)] for k in range(7, 20)])
    whole = found == "whole"
    assert (whole.sum(axis=0) == 1).all()  # of every camera one
    assert (found != "carry").sum(axis=1).max() <= 4  # never of all at a time
    assert not lookout.raise_alarm("cam2", BOX + 200.0, 20 * PERIOD)
    assert lookout.raise_alarm("cam2", BOX + 200.0, 40 * PERIOD)


def test_closer_looks_in_vain_wait_longer_and_longer():
    camera = CameraSchedule(0)
    taken = []
    for look in range(60):
        if camera.closer():
            camera.looked_closer(others=False)
            taken.append(look)
    assert np.diff(taken).tolist() == [2, 4, 8, 16, 16]
    camera.looked_closer(others=True)
    assert camera.closer()
