"""The order of views that arrive one by one."""

import numpy as np
import pytest

from panoptic_ros.continuous.view_order import TimedFrame, ViewOrder
from panoptic_ros.solving.frames import CameraFrame

MS = 1_000_000


def view(camera, time_ms):
    nothing = np.zeros((0, 19))
    return TimedFrame(time_ms * MS, camera, CameraFrame(camera, 0, np.zeros((0, 19, 2)), nothing, nothing))


def order(cameras=3, wait_ms=0):
    return ViewOrder([f"{k}" for k in range(cameras)], wait_ms * MS)


def put(found, *rows, correction_ms=0):
    return [found.put(view(camera, time), correction_ms * MS) for camera, time in rows]


def times(views):
    return [(one.camera, one.time_ns // MS) for one in views]


def test_the_order_is_that_of_the_times():
    found = order()
    rows = (0, 100), (2, 90), (1, 95), (0, 140), (1, 135), (2, 130)
    assert put(found, *rows) == [""] * 6
    assert found.known_ns == 140 * MS and found.next_ns == 90 * MS and found.last_ns == 140 * MS
    assert times(found.take(100 * MS)) == [(2, 90), (1, 95), (0, 100)]
    assert times(found.take(1000 * MS)) == [(2, 130), (1, 135), (0, 140)] and found.next_ns is None


def test_what_comes_after_its_turn_or_twice_is_left_out():
    found = order()
    put(found, (0, 100), (1, 110), (2, 120))
    found.take(115 * MS)
    assert put(found, (1, 114), (0, 116), (0, 116)) == ["late", "", "back"]


def test_nothing_is_known_before_all_cameras_have_two_views_or_a_second_is_over():
    found = order()
    put(found, (0, 0), (1, 10), (2, 20), (0, 100), (1, 110))
    assert found.known_ns is None
    put(found, (2, 120))
    assert found.known_ns == 120 * MS
    other = order()
    put(other, *((0, 100 * k) for k in range(11)))
    assert other.known_ns == 1000 * MS


def test_the_wait_and_corrections_of_clocks_put_the_known_time_off():
    found = order(wait_ms=30)
    put(found, (0, 0), (1, 0), (2, 0), (0, 100))
    put(found, (1, 130), correction_ms=20)
    put(found, (2, 90), correction_ms=-10)
    assert found.known_ns == (130 - 30 - 30) * MS


@pytest.mark.parametrize("ahead_ms", [700, 9000])
def test_a_camera_far_ahead_does_not_hurry_the_others(ahead_ms):
    found = order()
    for k in range(20):
        faults = put(found, (0, 50 * k), (1, 50 * k + 10), (2, 50 * k + ahead_ms))
        assert faults[:2] == ["", ""]
    assert faults[2] == "ahead" and found.known_ns == (50 * 19 + 10) * MS


def test_a_single_stamp_far_off_is_left_out_alone():
    found = order()
    put(found, *((c, 50 * k + c) for k in range(9) for c in range(3)))
    assert put(found, (0, 5000), (0, 451), (1, 455)) == ["ahead", "", ""]
    assert found.known_ns == 455 * MS


def test_time_goes_on_after_a_pause():
    found = order()
    put(found, *((c, 50 * k + c) for k in range(9) for c in range(3)))
    put(found, *((c, 60_000 + 50 * k + c) for k in range(3) for c in range(3)))
    assert found.known_ns == 60_102 * MS


def test_silent_cameras_do_not_hold_the_others():
    found = order()
    put(found, (0, -40), (1, -30), (2, -20), (0, 0), (1, 10), (2, 20))
    faults = put(found, *((0, 40 * k) for k in range(1, 60)))
    assert faults == [""] * 59 and found.known_ns == 40 * 59 * MS
