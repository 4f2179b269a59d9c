"""Read damaged copies of a sample, measure the time of each, and find foreign exceptions.

An exception is foreign if it is not a `UserError` with a short message. Timeouts and RuntimeWarnings count as
foreign too.
"""

from __future__ import annotations

import random
import signal
import time
import warnings
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType

from panoptic_ros.errors import ContractError, UserError, one_line
from panoptic_ros.study.faults.formats import FORMATS
from panoptic_ros.study.faults.mutations import mutated

LONGEST_S = 5.0  # time limit of a reader per copy
LONGEST_LINE = 2000  # limit of an error message, characters


class ReaderTimeout(BaseException):
    """Raised when a reader exceeds its time limit; a `BaseException`, so that no reader catches it."""


@dataclass
class Trials:
    """Outcomes of the copies of one format.

    Args:
        mutations, refused, accepted: number of copies tried, refused with an error, and read.
        slowest_s: longest time (s) of a copy.
        foreign: copy numbers by foreign exception.
    """

    mutations: int = 0
    refused: int = 0
    accepted: int = 0
    slowest_s: float = 0.0
    foreign: dict[str, list[int]] = field(default_factory=dict)


def copy_of(name: str, sample: bytes, seed: int, number: int) -> bytes:
    """Return the damaged copy of this number."""
    return mutated(sample, random.Random(f"{seed} {name} {number}"))


def try_copies(name: str, folder: Path, seed: int, numbers: Iterator[int]) -> Iterator[tuple[int, Trials]]:
    """Read damaged copies of a format's sample one by one; yield each number and the outcomes so far.

    Args:
        name: key of `FORMATS`.
        folder: empty folder; it holds the current copy.
        numbers: numbers of the copies.
    """
    form = FORMATS[name]
    path = form.sample(folder)
    sample = path.read_bytes()
    form.read(path)  # the undamaged sample must be readable
    found = Trials()
    for number in numbers:
        path.write_bytes(copy_of(name, sample, seed, number))
        began = time.perf_counter()
        told = outcome(name, path)
        found.slowest_s = max(found.slowest_s, time.perf_counter() - began)
        found.mutations += 1
        found.refused += told == "refused"
        found.accepted += told == "accepted"
        if told not in ("refused", "accepted"):
            found.foreign.setdefault(told, []).append(number)
        yield number, found


def outcome(name: str, path: Path) -> str:
    """Return "accepted", "refused", or a description of the foreign exception."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            with _alarm():
                FORMATS[name].read(path)
            told = "accepted"
        except ContractError as error:
            told = f"ContractError: {one_line(error)}"
        except UserError as error:
            line = str(error)
            short = "\n" not in line and len(line) < LONGEST_LINE
            told = "refused" if short else "the error is not a short line"
        except ReaderTimeout:
            told = f"took more than {LONGEST_S:g} s"
        except (Exception, MemoryError) as error:
            told = f"{type(error).__name__}: {one_line(error, 120)} ({_place(error)})"
    numbers = Counter(str(item.message)[:80] for item in caught if issubclass(item.category, RuntimeWarning))
    return f"RuntimeWarning: {next(iter(numbers))}" if numbers and told in ("accepted", "refused") else told


def _place(error: BaseException) -> str:
    """Return the last file and line of this package in the traceback of an exception."""
    trace, found = error.__traceback__, ""
    while trace is not None:
        file = trace.tb_frame.f_code.co_filename
        if "panoptic_ros" in file and "study/faults" not in file:
            found = f"{Path(file).name}:{trace.tb_lineno}"
        trace = trace.tb_next
    return found


@contextmanager
def _alarm() -> Iterator[None]:
    """Raise `ReaderTimeout` after `LONGEST_S`."""

    def over(number: int, frame: FrameType | None) -> None:
        raise ReaderTimeout

    before = signal.signal(signal.SIGALRM, over)
    signal.setitimer(signal.ITIMER_REAL, LONGEST_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
