"""Defines the exception family and its exit codes.

PanopticError (1, our own fault)
├── ContractError (1)      a contract inside the code was broken: a bug, please report it
└── UserError (2)          a fault that the user can fix
    ├── UsageError         arguments of a command or of a call
    ├── ConfigError        parameters: unknown, wrong type, out of range
    ├── CalibrationError   rigs, and what they state about the cameras
    ├── DataError          files, bags, messages and records with bad content
    ├── ClockError         timecode, timestamps and clock models
    ├── BackendError       models, execution providers, devices
    └── EnvironmentProblem what the machine lacks: packages, disk space, permissions

A message is one line that states what was found, where, and what to do. The command line catches the family
once, in `cli/main.py`. A node drops the item on DataError and ends on all others.
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

LIKE = 0.6  # minimum difflib ratio between a word and its misspelling; the default of difflib
MOST_WORDS = 12  # maximum number of words listed in a message
SHOWN = 60  # characters of a value in a message; a list of ten numbers fits
TOLD = 300  # characters of another library's message; a path and a sentence fit
LONGEST_INTEGER = 200  # bits; a longer integer has more than `SHOWN` digits


class PanopticError(Exception):
    """Base of all errors that this package raises on purpose."""

    exit_code = 1


class ContractError(PanopticError):
    """Error about a broken contract between parts of the code, i.e. a bug."""


class UserError(PanopticError):
    """Error about a fault that the user can fix. The message states the remedy."""

    exit_code = 2


class UsageError(UserError):
    """Error about arguments that make no sense."""


class ConfigError(UserError):
    """Error about a parameter that is unknown, of the wrong type or out of range."""


class CalibrationError(UserError):
    """Error about a rig that cannot be correct, or that does not fit the images."""


class DataError(UserError):
    """Error about a file, bag, message or record with bad content."""


class ClockError(UserError):
    """Error about timecode, timestamps or clock models that cannot be used."""


class BackendError(UserError):
    """Error about a model, execution provider or device that cannot be used."""


class EnvironmentProblem(UserError):
    """Error about something that the machine lacks: a package, disk space, a permission."""


def shown(value: Any, limit: int = SHOWN) -> str:
    """Return the beginning of `repr(value)`, without building the rest.

    A value from a hostile file can have a representation of any length, e.g. by aliases in YAML.

    Args:
        limit: maximum number of characters. A longer text is cut and ends with three dots.
    """
    text = ""
    for piece in _pieces(value, limit):
        text += piece
        if len(text) > limit:
            return text[:limit] + "..."
    return text


def nearest(word: Any, known: Iterable[str]) -> str:
    """Return the end of a message that suggests the known word nearest to `word`.

    If no word is near, it lists the known words, at most `MOST_WORDS`. Words are compared without case,
    blanks, hyphens and underscores.
    """
    from difflib import get_close_matches  # imported here, as few processes meet an unknown word

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
    """Yield the representation of a value in pieces. Every nested value begins a new piece."""
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
