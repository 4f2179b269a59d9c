"""Waiting for what nodes do."""
import time


def spin_until(executor, ready, seconds=15.0):
    """Spin until it has happened; fails if it does not in time."""
    end = time.monotonic() + seconds
    while not ready() and time.monotonic() < end:
        executor.spin_once(timeout_sec=0.05)
    assert ready(), "it did not happen in time"
