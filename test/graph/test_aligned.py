"""Live images of a camera with a wrong clock: put together by arrival, and named by its third image."""

import pytest

from panoptic_ros.graph.aligned import AlignedTimes

SECOND = 1_000_000_000
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
