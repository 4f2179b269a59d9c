"""Bars that a report has to reach, as written on a command line: `person_recall=0.98`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from panoptic_ros.errors import UsageError


@dataclass(frozen=True, slots=True)
class Limit:
    """A score by its name in `Report.to_mapping` (dots go into nested ones) and its bar."""

    name: str
    bar: float
    upper: bool = False  # the score must not be above the bar; else not below


def parse_limit(text: str, upper: bool = False) -> Limit:
    """`name=number`.

    Raises:
        UsageError: if the text is something else.
    """
    name, _, number = text.partition("=")
    try:
        return Limit(name.strip(), float(number), upper)
    except ValueError:
        raise UsageError(f"{text!r} is no bar for a score; write e.g. person_recall=0.98") from None


def failures(scores: Mapping[str, Any], limits: Sequence[Limit]) -> list[str]:
    """One phrase for every limit that the scores miss; a score that is not defined misses.

    Raises:
        UsageError: if there is no score of that name.
    """
    phrases = []
    for limit in limits:
        value = _score(scores, limit.name)
        missed = value is None or (value > limit.bar if limit.upper else value < limit.bar)
        if missed:
            shown = "not defined" if value is None else f"{value:.6g}"
            word = "most" if limit.upper else "least"
            phrases.append(f"{limit.name} is {shown}, not at {word} {limit.bar:g}")
    return phrases


def _score(scores: Mapping[str, Any], name: str) -> float | None:
    value: Any = scores
    rest = name
    while isinstance(value, Mapping):
        key = next((key for key in sorted(value, key=len, reverse=True) if _starts(rest, key)), None)
        if key is None:
            raise UsageError(f"there is no score {name!r}; there are {', '.join(value)}")
        value, rest = value[key], rest[len(key) + 1 :]
    if rest:
        if value is None:  # e.g. nees.cover95 of a result without covariances
            return None
        raise UsageError(f"there is no score {name!r}")
    score: float | None = value
    return score


def _starts(text: str, key: str) -> bool:
    return text == key or text.startswith(key + ".")
