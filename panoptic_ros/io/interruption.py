"""Handle requests to end (SIGINT, SIGTERM or SIGHUP): they interrupt the program, or end a live run."""

from __future__ import annotations

import _thread
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
# s. Further requests within this time are ignored, so that they do not cut the cleanup short.
TIDYING_S = 5.0
# s. Interval of repeats of a request until the program handles its KeyboardInterrupt; users do not notice it.
REPEAT_S = 0.02
# Modules whose Python functions are called by C++ code that does not expect exceptions. A KeyboardInterrupt
# there is lost, or ends the process with a segmentation fault: llvmlite links kernels, numba returns tuples.
UNSAFE_MODULES = ("llvmlite.", "numba.core.serialize")
# Times (s, monotonic) of accepted requests, i.e. without those within TIDYING_S after an accepted one.
_heeded: list[float] = []
# Times (s) of the accepted requests that raised KeyboardInterrupt.
_interruptions: list[float] = []
# Accepted requests (signal numbers) whose KeyboardInterrupt the program has not handled yet.
_unhandled: list[int] = []


def listen_to_signals(answer: Callable[[], None] | None = None) -> None:
    """Install signal handlers that interrupt the program, but not the cleanup that follows.

    Signals that are ignored stay ignored: under `nohup`, and in background jobs of a script. Destructors, and
    C code that clears errors, can lose a KeyboardInterrupt. It is raised again until `settle` is called.

    Args:
        answer: called instead of raising KeyboardInterrupt.
    """
    repeated: list[bool] = []
    main = _thread.get_ident()  # handlers are installed and run in the main thread

    def repeat(number: int) -> None:
        def send() -> None:
            time.sleep(REPEAT_S)
            if not _unhandled:
                return
            if signal.getsignal(number) is not hear:  # within `requests_held`
                repeat(number)
                return
            repeated.append(True)
            signal.pthread_kill(main, number)

        # `threading` takes a lock that the interrupted code may hold
        _thread.start_new_thread(send, ())

    def hear(number: int, frame: FrameType | None) -> None:
        new = not (repeated and repeated.pop()) and _is_heeded()
        if new:
            _unhandled.append(number)
        if not _unhandled:
            return
        if _is_unsafe(frame) or not (new or _is_lost()):
            repeat(number)
            return
        if answer is None:
            repeat(number)
            _interrupt()
        else:
            settle()
            answer()

    _handle(hear)
    before = sys.unraisablehook

    def tell(lost: Any) -> None:
        if not issubclass(lost.exc_type, KeyboardInterrupt):
            before(lost)

    sys.unraisablehook = tell  # do not print a lost KeyboardInterrupt: it is raised again


def settle() -> None:
    """Do not raise KeyboardInterrupt again for requests so far: the program has handled them."""
    _unhandled.clear()


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

    def note(number: int, frame: FrameType | None) -> None:
        if _is_heeded():
            if told and not _is_unsafe(frame):
                _interrupt()
            told.append(True)

    settle()
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


def _is_unsafe(frame: FrameType | None) -> bool:
    """Return whether a function of UNSAFE_MODULES is active in a stack of calls."""
    while frame is not None:
        if str(frame.f_globals.get("__name__")).startswith(UNSAFE_MODULES):
            return True
        frame = frame.f_back
    return False


def _is_lost() -> bool:
    """Return whether a KeyboardInterrupt is lost: the interrupted code is not part of its handling."""
    error = sys.exc_info()[1]
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__context__
    return error is None


def _handle(handler: Callable[[int, FrameType | None], None]) -> None:
    for number in SIGNALS:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, handler)
