"""Handle requests to end (SIGINT, SIGTERM or SIGHUP): they interrupt the program, or end a live run."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
# s. Further requests within this time are ignored, so that they do not cut the cleanup short.
TIDYING_S = 5.0
# Times (s, monotonic) of accepted requests, i.e. without those within TIDYING_S after an accepted one.
_heeded: list[float] = []
# Times (s) of the accepted requests that raised KeyboardInterrupt.
_interruptions: list[float] = []


def listen_to_signals(answer: Callable[[], None] | None = None) -> None:
    """Install signal handlers that interrupt the program, but not the cleanup that follows.

    Signals that are ignored stay ignored: under `nohup`, and in background jobs of a script.

    Args:
        answer: called instead of raising KeyboardInterrupt. An exception is lost if the signal arrives while
            a destructor runs.
    """

    def hear(number: int, frame: object) -> None:
        if _is_heeded():
            (answer or _interrupt)()

    _handle(hear)
    before = sys.unraisablehook

    def tell(lost: Any) -> None:
        if not issubclass(lost.exc_type, KeyboardInterrupt):
            before(lost)

    sys.unraisablehook = tell  # do not print a lost KeyboardInterrupt: `interrupted` reports it


def interrupted() -> bool:
    """Return whether a request has interrupted this program."""
    return bool(_interruptions)


@contextmanager
def first_request_told(wanted: bool = True) -> Iterator[Callable[[], bool]]:
    """Yield a function that returns whether a request has arrived; the first request raises nothing.

    A second request raises KeyboardInterrupt. The function also reports a KeyboardInterrupt that was lost,
    for example inside a destructor.

    Args:
        wanted: if False, leave the signal handlers unchanged.
    """
    if not wanted:
        yield interrupted
        return
    told: list[bool] = []
    _heeded.clear()  # earlier requests must not hide the first request of this block
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
    """Ignore requests to end within the block, for work that must be finished such as closing a take."""
    before = {number: signal.getsignal(number) for number in SIGNALS}
    _handle(lambda number, frame: None)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _is_heeded() -> bool:
    """Return whether a request is accepted: the first one, or TIDYING_S after the last. Record it then."""
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
