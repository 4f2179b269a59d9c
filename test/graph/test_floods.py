"""A topic is left alone while it brings more than can be read."""

import pytest

from panoptic_ros.graph.floods import LONGEST_PAUSE_NS, MOST_BAD, PAUSE_NS, SECOND, FloodGuard


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
