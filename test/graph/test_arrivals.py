"""Rate, age and losses of one topic.

A topic is left alone while it brings more than can be read.
"""

import pytest

from panoptic_ros.graph.arrivals import (
    LONGEST_PAUSE_NS,
    MOST_BAD,
    PAUSE_NS,
    SECOND,
    ArrivalCounters,
    FloodGuard,
)

PERIOD = SECOND // 30


def played(count, period=PERIOD, **more):
    arrivals = ArrivalCounters("detections", "left", "/left/detections", True, 0)
    for k in range(count):
        arrivals.came(k * period, k + 1, **more)
    return arrivals


def test_rate_period_and_latency_of_a_steady_camera():
    arrivals = played(90, latency_ns=4_000_000)
    values = arrivals.values(90 * PERIOD)
    assert float(values["rate_hz"]) == pytest.approx(30.0, rel=0.01)
    assert float(values["period_ms"]) == pytest.approx(33.3, abs=0.1)
    assert values["latency_p50_ms"] == values["latency_p99_ms"] == "4.00"
    assert values["lost"] == values["left_out"] == values["bad"] == "0"


@pytest.mark.parametrize(("period", "named_after"), [(PERIOD, 1.0), (2 * SECOND, 6.0)])
def test_silence_is_named_after_a_second_or_three_periods_and_clears(period, named_after):
    arrivals = played(20, period)
    last = 19 * period
    assert not arrivals.trouble(round(last + (named_after - 0.01) * SECOND))
    trouble = arrivals.trouble(round(last + (named_after + 0.01) * SECOND))
    assert trouble == f"no left detections for {named_after:.1f} s"
    arrivals.came(last + 10 * SECOND, 21)
    assert not arrivals.trouble(last + 10 * SECOND + 1)


def test_a_camera_that_never_came_is_named():
    arrivals = ArrivalCounters("detections", "left", "/left/detections", True, 5 * SECOND)
    assert not arrivals.trouble(round(5.9 * SECOND))
    assert arrivals.trouble(7 * SECOND) == "no left detections was received yet, 2.0 s after the start"


def test_what_is_no_stream_may_be_silent():
    arrivals = ArrivalCounters("clock_models", "", "/clock_models", False, 0)
    assert not arrivals.trouble(100 * SECOND) and arrivals.values(100 * SECOND)["age_s"] == "nan"


def test_how_much_is_lost_of_late():
    arrivals = ArrivalCounters("image", "left", "/left/image_raw", True, 0)
    shares = []
    for k in range(200):
        arrivals.came(k * PERIOD, 1 + 4 * k if k < 100 else 301 + k)
        shares.append(arrivals.lost_share())
    assert shares[:2] == [0.0] * 2 and shares[99] == pytest.approx(0.75, abs=0.01)
    assert shares[199] == 0.0


def test_lost_on_the_way_is_told_apart_from_never_sent():
    arrivals = played(10)
    for number in range(10):
        arrivals.numbered(number)
    arrivals.came(10 * PERIOD, 14)  # three messages lost; the detector left out two frames besides
    assert arrivals.lost == 3
    assert arrivals.numbered(15) == 2 and arrivals.left_out == 2


def test_a_publisher_that_begins_anew_or_an_odd_number_loses_nothing():
    arrivals = played(100)
    for sequence in (1, 2, 3, 2**40, 4, 5):
        arrivals.came(200 * PERIOD, sequence)
    assert arrivals.lost == 0
    assert [arrivals.numbered(n) for n in (7, 2**60, 8, 9)] == [0, 0, 0, 0]


def test_two_publishers_of_one_topic_do_not_make_losses():
    arrivals = ArrivalCounters("detections", "left", "/left/detections", True, 0)
    for k in range(50):
        arrivals.came(k, 1000 + k)
        arrivals.came(k, 1 + k)
    assert arrivals.lost == 0
    arrivals.came(99, 1052)
    assert arrivals.lost == 2


def verdicts(rate, seconds, size=8000, bad=False):
    guard = FloodGuard()
    return [guard.came(k * SECOND // rate, size, k + 1 if bad else 0) for k in range(round(rate * seconds))]


@pytest.mark.parametrize(("rate", "size"), [(30, 12_000), (240, 12_000), (60, 365_000)])
def test_cameras_are_no_flood(rate, size):
    assert not any(verdicts(rate, 5, size))


@pytest.mark.parametrize(
    ("rate", "size", "bad", "why"),
    [
        (2400, 3000, True, "bad messages"),
        (100, 1_000_000, False, "MB a second"),
        (2400, 100, False, "messages a second"),
    ],
)
def test_floods_are_seen_within_a_second(rate, size, bad, why):
    found = [text for text in verdicts(rate, 1, size, bad) if text]
    assert found and why in found[0]


def test_a_camera_that_sends_nothing_but_bad_messages_is_listened_to():
    assert not any(verdicts(MOST_BAD - 1, 5, bad=True))


def test_pauses_grow_while_the_flood_lasts():
    guard, now, pauses = FloodGuard(), 0, []
    for _ in range(6):
        pauses.append(guard.pause(now))
        now += pauses[-1] + SECOND // 2
    assert pauses[0] == PAUSE_NS and pauses[-1] == LONGEST_PAUSE_NS
    assert guard.pause(now + 60 * SECOND) == PAUSE_NS
