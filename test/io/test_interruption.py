"""Requests to end interrupt, or are told, and are not heard twice while a program tidies up."""

import contextlib
import ctypes
import os
import signal
import sys
import time
from pathlib import Path

import pytest

from panoptic_ros.io import interruption


@pytest.fixture(autouse=True)
def as_before(monkeypatch):
    monkeypatch.setattr(interruption, "_heeded", [])
    monkeypatch.setattr(interruption, "_interruptions", [])
    monkeypatch.setattr(interruption, "_unhandled", [])
    monkeypatch.setattr(sys, "unraisablehook", sys.unraisablehook)
    handlers = {number: signal.getsignal(number) for number in interruption.SIGNALS}
    yield
    for number, handler in handlers.items():
        signal.signal(number, handler)


@contextlib.contextmanager
def raised():
    """Expect a KeyboardInterrupt and handle it, as `main` does."""
    with pytest.raises(KeyboardInterrupt):
        try:
            yield
        except KeyboardInterrupt:
            interruption.settle()
            raise


def send(number):
    os.kill(os.getpid(), number)


@pytest.mark.parametrize("number", interruption.SIGNALS)
def test_a_request_interrupts_once_while_the_program_tidies_up(number):
    interruption.listen_to_signals()
    with raised():
        send(number)
    send(number)
    assert interruption.interrupted()


def test_a_request_is_answered_in_another_way():
    answers = []
    interruption.listen_to_signals(lambda: answers.append(1))
    send(signal.SIGTERM)
    send(signal.SIGTERM)
    assert answers == [1] and not interruption.interrupted()


def test_what_is_ignored_stays_ignored():
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    interruption.listen_to_signals()
    with interruption.first_request_told() as asked:
        send(signal.SIGHUP)
        assert not asked()
    assert not interruption.interrupted()


@pytest.mark.parametrize("number", interruption.SIGNALS)
def test_the_first_request_is_told_and_a_later_one_interrupts(number, monkeypatch):
    interruption.listen_to_signals()
    with raised(), interruption.first_request_told() as asked:
        assert not asked()
        send(number)
        assert asked()
        send(number)  # impatient
        monkeypatch.setattr(interruption, "TIDYING_S", -1.0)
        send(number)
    with raised():
        send(number)


def test_what_follows_a_told_request_is_not_cut_short():
    interruption.listen_to_signals()
    with interruption.first_request_told() as asked:
        send(signal.SIGINT)
        assert asked()
    send(signal.SIGINT)
    assert not interruption.interrupted()


class Destroyed:
    """Object whose destructor receives a request. Python ignores exceptions there."""

    def __del__(self):
        send(signal.SIGINT)


def test_an_interruption_that_met_a_destructor_is_told():
    interruption.listen_to_signals()
    Destroyed()
    with interruption.first_request_told() as asked:
        assert asked()
        time.sleep(5 * interruption.REPEAT_S)  # it is not raised again


def test_an_interruption_that_met_a_destructor_interrupts_later():
    interruption.listen_to_signals()
    with raised():
        Destroyed()
        time.sleep(5.0)
    assert len(interruption._interruptions) == 2  # the lost one, and once more


def clear_errors():
    """Return a function of C that receives a request and clears the error that it causes."""
    return ctypes.CFUNCTYPE(None)(lambda: send(signal.SIGTERM))


def test_an_interruption_that_c_code_clears_is_raised_again():
    interruption.listen_to_signals()
    with raised():
        clear_errors()()
        time.sleep(5.0)
    assert len(interruption._interruptions) == 2  # the lost one, and once more


def test_an_interruption_is_not_raised_again_while_it_is_handled():
    interruption.listen_to_signals()
    tidied = False
    with raised():
        try:
            send(signal.SIGTERM)
        finally:
            with contextlib.suppress(OSError):
                Path("/no/such/file").stat()
            time.sleep(5 * interruption.REPEAT_S)
            tidied = True
    assert tidied
    time.sleep(5 * interruption.REPEAT_S)


def test_an_interruption_waits_for_held_requests():
    interruption.listen_to_signals()
    with raised():
        clear_errors()()
        with interruption.requests_held():
            time.sleep(5 * interruption.REPEAT_S)
        time.sleep(5.0)
    assert len(interruption._interruptions) == 2  # the lost one, and once more


@pytest.mark.parametrize("module", ["llvmlite.binding.ffi", "numba.core.serialize"])
@pytest.mark.parametrize("answered", [True, False])
def test_code_that_must_not_raise_is_not_interrupted(module, answered):
    answers = []
    interruption.listen_to_signals((lambda: answers.append(1)) if answered else None)
    loader = {"__name__": module, "send": send, "wait": lambda: time.sleep(0.1), "loaded": []}
    exec("def load():\n    send(15)\n    wait()\n    loaded.append(1)", loader)
    with contextlib.nullcontext() if answered else raised():
        loader["load"]()
        time.sleep(0.5)
    assert loader["loaded"] == [1] and answers == [1] * answered


def test_where_it_is_not_wanted_requests_interrupt():
    interruption.listen_to_signals()
    with raised(), interruption.first_request_told(False) as asked:
        assert not asked()
        send(signal.SIGINT)
