"""Opening several at a time keeps their order and leaves nothing open after an error."""

import threading

import pytest

from panoptic_ros.capture.at_once import opened_at_once


class Thing:
    def __init__(self, name):
        self.name, self.open = name, True

    def close(self):
        self.open = False


def test_the_order_is_that_of_the_names_whoever_is_first():
    last_is_open = threading.Event()

    def open_one(name):
        if name == "c":
            last_is_open.set()
        assert last_is_open.wait(5.0)  # all are under way together
        return Thing(name)

    assert [thing.name for thing in opened_at_once(open_one, "abc")] == ["a", "b", "c"]


def test_the_first_error_counts_and_the_others_are_closed():
    things = []

    def open_one(name):
        if name in "bd":
            raise ValueError(name)
        things.append(Thing(name))
        return things[-1]

    with pytest.raises(ValueError, match="b"):
        opened_at_once(open_one, "abcd")
    assert sorted(thing.name for thing in things) == ["a", "c"]
    assert not any(thing.open for thing in things)
