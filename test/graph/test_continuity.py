"""Wild stamps do not get to stages; another time line does, once it is certain.

Live images of a camera with a wrong clock: put together by arrival, and named by its third image.
"""

import pytest

from panoptic_ros.graph.continuity import SECOND, SURE, AlignedTimes, Continuity

PERIOD = SECOND // 30
BEGIN = 1_700_000_000 * SECOND


def running(count=30):
    gate = Continuity()
    for k in range(count):
        assert gate.judge(BEGIN + k * PERIOD, k * PERIOD) == ""
        gate.used(BEGIN + k * PERIOD, k * PERIOD)
    return gate, count


def test_a_wild_stamp_is_refused_and_the_next_good_one_goes_on():
    gate, k = running()
    for wild in (3600 * SECOND, -3600 * SECOND, SECOND, 2**62 - BEGIN):
        assert gate.judge(BEGIN + k * PERIOD + wild, k * PERIOD) == "odd_stamp"
    assert gate.judge(BEGIN + k * PERIOD, k * PERIOD) == ""


def test_copies_of_old_messages_are_stale():
    gate, k = running()
    for age in (1, 5, 20, 60):
        assert gate.judge(BEGIN + (k - age) * PERIOD, k * PERIOD) == "stale"


def test_a_plausible_stamp_that_was_not_used_moves_nothing():
    gate, k = running()
    assert gate.judge(BEGIN + (k + 5) * PERIOD, k * PERIOD) == ""  # its content was bad
    assert gate.judge(BEGIN + k * PERIOD, k * PERIOD) == ""


def test_a_pause_is_no_jump():
    gate, k = running()
    assert gate.judge(BEGIN + k * PERIOD + 60 * SECOND, k * PERIOD + 60 * SECOND) == ""


def test_what_comes_in_time_after_a_stall_is_not_ahead():
    """After 3 s in which nothing was read the oldest and the newest come at once; most between are lost."""
    gate, k = running()
    now = (k + 90) * PERIOD
    assert gate.judge(BEGIN + k * PERIOD, now) == ""
    gate.used(BEGIN + k * PERIOD, now)
    assert gate.judge(BEGIN + (k + 90) * PERIOD, now + 1) == ""
    assert gate.judge(BEGIN + (k + 90) * PERIOD + SECOND, now + 1) == "odd_stamp"


def test_the_first_record_may_be_used_long_after_it_came():
    gate = Continuity()
    assert gate.judge(BEGIN, 0) == ""
    gate.used(BEGIN, 3 * SECOND)  # stages compiled
    assert gate.judge(BEGIN + 3 * SECOND, 3 * SECOND) == ""
    assert gate.judge(BEGIN + 3600 * SECOND, 3 * SECOND) == "odd_stamp"


def test_where_stamps_go_slower_than_the_clock_what_is_plausible_stays_bounded():
    gate = Continuity()
    for k in range(60 * 30):
        gate.used(BEGIN + k * PERIOD // 2, k * PERIOD)
    k += 1
    assert gate.judge(BEGIN + k * PERIOD // 2 + 30 * SECOND, k * PERIOD) == "odd_stamp"


def test_another_time_line_is_taken_when_nothing_of_the_old_one_comes_between():
    gate, k = running()
    verdicts = [gate.judge(5 * SECOND + n * PERIOD, (k + n) * PERIOD) for n in range(60)]
    first = verdicts.index("")
    assert 30 <= first <= 30 + SURE and set(verdicts[:first]) == {"odd_stamp"}
    gate.used(5 * SECOND + first * PERIOD, (k + first) * PERIOD)
    assert gate.judge(5 * SECOND + (first + 1) * PERIOD, (k + first + 1) * PERIOD) == ""


def test_copies_of_some_old_messages_time_and_again_are_no_time_line():
    gate, k = running(90)
    for n in range(2000):
        now = k * PERIOD + n * SECOND // 2400
        assert gate.judge(BEGIN + (n % 8) * PERIOD, now) == "stale"
        if n % 80 == 0:
            assert gate.judge(BEGIN + now, now) == ""
            gate.used(BEGIN + now, now)


def test_an_odd_time_line_beside_the_good_one_is_never_taken():
    gate, k = running()
    for n in range(50):
        now = (k + n) * PERIOD
        assert gate.judge(BEGIN + now + 100 * SECOND, now) == "odd_stamp"
        assert gate.judge(BEGIN + now, now) == ""
        gate.used(BEGIN + now, now)


@pytest.mark.parametrize("rate_hz, faster", [(1.0, 4.0), (2.0, 4.0), (0.5, 2.0)])
def test_a_slow_recording_that_is_played_faster_is_taken_once_it_is_certain(rate_hz, faster):
    gate, step = Continuity(), round(SECOND / rate_hz)
    verdicts = []
    for k in range(60):
        now = round(k * step / faster)
        verdicts.append(gate.judge(BEGIN + k * step, now))
        if not verdicts[-1]:
            gate.used(BEGIN + k * step, now)
    assert set(verdicts[-40:]) == {""}
    assert gate.judge(BEGIN + 60 * step + 60 * SECOND, round(60 * step / faster)) == "odd_stamp"


def test_copies_of_a_stretch_of_old_messages_never_take_over():
    gate, k = running()
    now = k * PERIOD + 2 * SECOND  # nothing good for so long, as after a moment without a processor
    copies = [BEGIN + n * PERIOD for n in range(k - 9, k)]
    for n in range(20_000):  # eight seconds of 2400 a second
        assert gate.judge(copies[n % 8], now + n * SECOND // 2400) == "stale"
    now += 9 * SECOND
    assert gate.judge(BEGIN + now, now) == ""


EPOCH = 1_700_000_000 * SECOND
WRONG = {
    "5 s ahead": lambda t: t + 5 * SECOND,
    "1 h behind": lambda t: t - 3600 * SECOND,
    "2^32 ns ahead": lambda t: t + 2**32,
    "zero": lambda t: 0,
    "since boot": lambda t: t - EPOCH + SECOND,
}


def images(rate, seconds, bad, begin_s, stamp):
    """(seconds, camera, aligned time, true time, codes of notices) of each image of four cameras."""
    times, found = AlignedTimes("abcd"), []
    for k in range(round(rate * seconds)):
        true = EPOCH + round(k / rate * SECOND)
        for j, camera in enumerate("abcd"):
            wrong = camera == bad and k / rate >= begin_s
            came = round(k / rate * SECOND) + j * 3_000_000
            aligned, notices = times.time_of(camera, stamp(true) if wrong else true, came, EPOCH + came)
            found.append((k / rate, camera, aligned, true, [notice.code for notice in notices]))
    return found


@pytest.mark.parametrize("kind", WRONG)
@pytest.mark.parametrize("rate", [1.5, 4.0, 30.0])
def test_a_wrong_camera_is_aligned_by_arrival_and_named_by_its_images(kind, rate):
    found = images(rate, 12.0, "c", 5.0, WRONG[kind])
    told = [(at, camera) for at, camera, *_, codes in found if "sync.clock_off" in codes]
    assert {camera for _, camera in told} == {"c"}
    assert told[0][0] - 5.0 <= max(1.0, 3 / rate)
    assert all(abs(aligned - true) <= 0.05 * SECOND for at, _, aligned, true, _ in found if at > 1.5)


def test_stamps_that_agree_stay_as_they_are_without_a_notice():
    found = images(10.0, 20.0, "", 0.0, None)
    assert all(aligned == true and not codes for _, _, aligned, true, codes in found)
