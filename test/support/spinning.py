"""Waiting for what nodes do."""

import time


def spin_until(executor, ready, seconds=15.0):
    """Spin until it has happened; fails if it does not in time."""
    end = time.monotonic() + seconds
    while not ready() and time.monotonic() < end:
        executor.spin_once(timeout_sec=0.05)
    assert ready(), "it did not happen in time"


def spin_until_quiet(executor, heard, quiet=1.5, seconds=30.0):
    """Spin until nothing new has been heard for `quiet` seconds; fails if it never ends."""
    count, last = len(heard), time.monotonic()
    end = last + seconds
    while (now := time.monotonic()) - last < quiet:
        assert now < end, "it did not become quiet in time"
        executor.spin_once(timeout_sec=0.05)
        if len(heard) != count:
            count, last = len(heard), time.monotonic()
