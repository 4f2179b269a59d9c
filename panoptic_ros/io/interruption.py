"""Requests to end, by SIGINT, SIGTERM or SIGHUP: they interrupt the program, or end a live run."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
TIDYING_S = 5.0  # further requests within this time must not cut the tidying up short
_heeded: list[float] = []  # when requests came, s, but for those while an earlier one was answered
_interruptions: list[float] = []  # those among them that interrupted the program


def listen_to_signals(answer: Callable[[], None] | None = None) -> None:
    """Let requests to end interrupt the program, but not the tidying up that follows.

    What is ignored stays so: `nohup`, and jobs in the background of a script.

    Args:
        answer: what a request does instead; interruptions get lost where they meet a destructor.
    """

    def hear(number: int, frame: object) -> None:
        if _is_heeded():
            (answer or _interrupt)()

    _handle(hear)
    before = sys.unraisablehook

    def tell(lost: Any) -> None:
        if not issubclass(lost.exc_type, KeyboardInterrupt):
            before(lost)

    sys.unraisablehook = tell  # a lost interruption is no news: `interrupted` tells of it


def interrupted() -> bool:
    """Whether a request has interrupted this program."""
    return bool(_interruptions)


@contextmanager
def first_request_told(wanted: bool = True) -> Iterator[Callable[[], bool]]:
    """Within it the first request interrupts nothing; the function that is given tells of it.

    It also tells of an interruption that got lost, as where it met a destructor.

    Args:
        wanted: if False, nothing else changes.
    """
    if not wanted:
        yield interrupted
        return
    told: list[bool] = []
    _heeded.clear()  # what was answered before does not hide the first request of this work
    before = {number: signal.getsignal(number) for number in SIGNALS}

    def note(number: int, frame: object) -> None:
        if _is_heeded():
            if told:
                _interrupt()
            told.append(True)

    _handle(note)
    try:
        yield lambda: bool(told) or interrupted()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def requests_held() -> Iterator[None]:
    """Let requests to end do nothing within it: for work that must be finished, as closing a take."""
    before = {number: signal.getsignal(number) for number in SIGNALS}
    _handle(lambda number, frame: None)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _is_heeded() -> bool:
    """Whether a request of now is the first, or comes long after the last; remembers it then."""
    now = time.monotonic()
    heeded = not _heeded or now - _heeded[-1] > TIDYING_S
    if heeded:
        _heeded.append(now)
    return heeded


def _interrupt() -> None:
    _interruptions.append(_heeded[-1])
    raise KeyboardInterrupt


def _handle(handler: Callable[[int, object], None]) -> None:
    for number in SIGNALS:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, handler)
