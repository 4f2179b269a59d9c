"""Requests to end interrupt, or are told, and are not heard twice while a program tidies up."""

import os
import signal
import sys

import pytest

from panoptic_ros.io import interruption


@pytest.fixture(autouse=True)
def as_before(monkeypatch):
    monkeypatch.setattr(interruption, "_heeded", [])
    monkeypatch.setattr(interruption, "_interruptions", [])
    monkeypatch.setattr(sys, "unraisablehook", sys.unraisablehook)
    handlers = {number: signal.getsignal(number) for number in interruption.SIGNALS}
    yield
    for number, handler in handlers.items():
        signal.signal(number, handler)


def send(number):
    os.kill(os.getpid(), number)


@pytest.mark.parametrize("number", interruption.SIGNALS)
def test_a_request_interrupts_once_while_the_program_tidies_up(number):
    interruption.listen_to_signals()
    with pytest.raises(KeyboardInterrupt):
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
    with pytest.raises(KeyboardInterrupt), interruption.first_request_told() as asked:
        assert not asked()
        send(number)
        assert asked()
        send(number)  # impatient
        monkeypatch.setattr(interruption, "TIDYING_S", -1.0)
        send(number)
    with pytest.raises(KeyboardInterrupt):
        send(number)


def test_what_follows_a_told_request_is_not_cut_short():
    interruption.listen_to_signals()
    with interruption.first_request_told() as asked:
        send(signal.SIGINT)
        assert asked()
    send(signal.SIGINT)
    assert not interruption.interrupted()


@pytest.mark.parametrize("wanted", [True, False])
def test_an_interruption_that_met_a_destructor_is_told(wanted):
    class Destroyed:
        def __del__(self):
            send(signal.SIGINT)

    interruption.listen_to_signals()
    Destroyed()  # Python ignores what is raised there
    with interruption.first_request_told(wanted) as asked:
        assert asked()


def test_where_it_is_not_wanted_requests_interrupt():
    interruption.listen_to_signals()
    with pytest.raises(KeyboardInterrupt), interruption.first_request_told(False) as asked:
        assert not asked()
        send(signal.SIGINT)
