"""Parses parameters that assign values to names, such as ("cam01=8.3", "*=4")."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from panoptic_ros.errors import ConfigError, shown

ALL = "*"


def named_words(where: str, entries: Iterable[str]) -> dict[str, str]:
    """Return {name: word} from entries of the form "name=word". The name "*" stands for all other names.

    Args:
        where: name of the parameter, for the message.

    Raises:
        ConfigError: for an entry of another form, or a repeated name.
    """
    words: dict[str, str] = {}
    for entry in entries:
        name, equals, word = (part.strip() for part in entry.partition("="))
        if not (name and equals and word):
            raise ConfigError(f"{where}: {shown(entry)} is not of the form name=value, e.g. cam01=8.3")
        if name in words:
            raise ConfigError(f"{where} names {shown(name)} twice")
        words[name] = word
    return words


def named_numbers(where: str, entries: Iterable[str]) -> dict[str, float]:
    """Return {name: number} from entries of the form "name=number". The numbers must be finite.

    Args:
        where: name of the parameter, for the message.

    Raises:
        ConfigError: for an entry of another form, a repeated name, or a value that is not a finite number.
    """
    numbers = {}
    for name, word in named_words(where, entries).items():
        try:
            numbers[name] = float(word)
        except ValueError:
            numbers[name] = math.nan
        if not math.isfinite(numbers[name]):
            raise ConfigError(f"{where}: {shown(word)} of {shown(name)} is not a number")
    return numbers


def of_name(values: Mapping[str, float], name: str) -> float:
    """Return the number of a name, else that of "*", else 0."""
    return values.get(name, values.get(ALL, 0.0))
