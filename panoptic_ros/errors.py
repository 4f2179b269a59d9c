"""The exception family and its exit codes.

PanopticError (1, our own fault)
├── ContractError (1)      a promise inside the code was broken: a bug, please report it
└── UserError (2)          something that the user can mend
    ├── UsageError         arguments of a command or of a call
    ├── ConfigError        parameters: unknown, wrong type, out of range
    ├── CalibrationError   rigs and what they claim about the cameras
    ├── DataError          files, bags, messages and records with bad content
    ├── ClockError         timecode, stamps and clock models
    ├── BackendError       models, execution providers, devices
    └── EnvironmentProblem what the machine lacks: packages, disk space, permissions

Messages are one line that says what was found, where, and what to do. The command line catches
the family once, in `cli/main.py`; a node drops the item on DataError and ends on all others.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

__all__ = [
    "BackendError",
    "CalibrationError",
    "ClockError",
    "ConfigError",
    "ContractError",
    "DataError",
    "EnvironmentProblem",
    "PanopticError",
    "UsageError",
    "UserError",
    "nearest",
    "one_line",
    "plain",
    "shown",
]

LIKE = 0.6  # ratio of difflib, from which a word may be another one misspelt: its own default
MOST_WORDS = 12  # that a message lists
SHOWN = 60  # characters of a value in a message: a list of ten numbers fits
TOLD = 300  # characters of another library's message: a path and a sentence fit
LONGEST_INTEGER = 200  # bits; more do not fit into `SHOWN` digits


class PanopticError(Exception):
    """Base of all errors that this package raises on purpose."""

    exit_code = 1


class ContractError(PanopticError):
    """A promise between parts of the code was broken: a bug."""


class UserError(PanopticError):
    """Something that the user can mend; the message says how."""

    exit_code = 2


class UsageError(UserError):
    """Arguments that make no sense."""


class ConfigError(UserError):
    """A parameter is unknown, of the wrong type or out of range."""


class CalibrationError(UserError):
    """A rig that cannot be right, or that does not fit the images."""


class DataError(UserError):
    """A file, bag, message or record with bad content."""


class ClockError(UserError):
    """Timecode, stamps or clock models that cannot be used."""


class BackendError(UserError):
    """A model, execution provider or device that cannot be used."""


class EnvironmentProblem(UserError):
    """The machine lacks something: a package, disk space, a permission."""


def shown(value: Any, limit: int = SHOWN) -> str:
    """Return the beginning of `repr(value)`, without building the rest.

    A value of a hostile file can have a representation of any length, e.g. by aliases in YAML.

    Args:
        limit: characters; a longer text ends with three dots.
    """
    text = ""
    for piece in _pieces(value, limit):
        text += piece
        if len(text) > limit:
            return text[:limit] + "..."
    return text


def nearest(word: Any, known: Iterable[str]) -> str:
    """Return the known word that is perhaps meant, as the end of a message; without one all known words.

    Words are compared without case, blanks, hyphens and underscores.
    """
    from difflib import get_close_matches  # only now: few processes meet a word that is not known

    by_plain = {plain(name): name for name in known}
    close = get_close_matches(plain(str(word)[:SHOWN]), list(by_plain), 1, LIKE)
    if close:
        return f"the nearest known one is {by_plain[close[0]]!r}"
    names = list(by_plain.values())
    return f"known are {', '.join(names[:MOST_WORDS])}" + (", ..." if len(names) > MOST_WORDS else "")


def plain(word: str) -> str:
    """Return a word without case, blanks, hyphens and underscores."""
    return "".join(letter for letter in word.lower() if letter not in " -_")


def one_line(error: BaseException, limit: int = TOLD) -> str:
    """Return the message of another library's exception as one line of limited length."""
    arguments = error.args
    if len(arguments) == 1 and not isinstance(arguments[0], str):
        return shown(arguments[0], limit)
    text = " ".join(str(error)[: 10 * limit].split())
    return (text if len(text) <= limit else text[:limit] + "...") or type(error).__name__


def _pieces(value: Any, limit: int) -> Iterator[str]:
    """Yield the representation piece by piece; every level of nesting begins with a piece of its own."""
    if isinstance(value, str | bytes):
        yield repr(value[: limit + 1])
    elif isinstance(value, Mapping):
        yield "{"
        for number, (key, entry) in enumerate(value.items()):
            yield ", " if number else ""
            yield from _pieces(key, limit)
            yield ": "
            yield from _pieces(entry, limit)
        yield "}"
    elif isinstance(value, list):
        yield from _row("[", value, "]", limit)
    elif type(value) is tuple:
        yield from _row("(", value, ",)" if len(value) == 1 else ")", limit)
    elif isinstance(value, set | frozenset):
        yield from _row("{", value, "}", limit)
    elif isinstance(value, int) and value.bit_length() > LONGEST_INTEGER:
        yield f"a whole number of {value.bit_length()} bits"
    else:
        yield repr(value)


def _row(begin: str, values: Iterable[Any], end: str, limit: int) -> Iterator[str]:
    yield begin
    for number, value in enumerate(values):
        yield ", " if number else ""
        yield from _pieces(value, limit)
    yield end
