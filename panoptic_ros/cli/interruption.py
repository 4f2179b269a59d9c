"""Requests to end, by SIGINT, SIGTERM or SIGHUP: they interrupt the program, or end a live run."""
from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
TIDYING_S = 5.0  # further requests within this time must not cut the tidying up short
_asked: list[float] = []  # when, s


def listen_to_signals() -> None:
    """Let requests to end interrupt the program, but not the tidying up that follows.

    What is ignored stays so: `nohup`, and jobs in the background of a script.
    """

    def interrupt(number: int, frame: object) -> None:
        if _is_new(_asked):
            raise KeyboardInterrupt

    _handle(interrupt)


def interrupted() -> bool:
    """Whether a request has interrupted this program."""
    return bool(_asked)


@contextmanager
def first_request_told(wanted: bool = True) -> Iterator[Callable[[], bool]]:
    """Within it the first request interrupts nothing; the function that is given tells of it.

    Args:
        wanted: if False, nothing changes and the function says no.
    """
    if not wanted:
        yield lambda: False
        return
    told: list[float] = []
    before = {number: signal.getsignal(number) for number in SIGNALS}

    def note(number: int, frame: object) -> None:
        if _is_new(told) and len(told) > 1:
            _asked.append(told[-1])
            raise KeyboardInterrupt

    _handle(note)
    try:
        yield lambda: bool(told)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _is_new(requests: list[float]) -> bool:
    """Whether a request of now is the first, or comes long after the last; remembers it then."""
    now = time.monotonic()
    new = not requests or now - requests[-1] > TIDYING_S
    if new:
        requests.append(now)
    return new


def _handle(handler: Callable[[int, object], None]) -> None:
    for number in SIGNALS:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, handler)
