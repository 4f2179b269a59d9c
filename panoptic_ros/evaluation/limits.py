"""Limits on scores that a report must meet, as written on a command line: `person_recall=0.98`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from panoptic_ros.errors import UsageError


@dataclass(frozen=True, slots=True)
class Limit:
    """Limit on a score, which is named as in `Report.to_mapping`; dots address nested scores."""

    name: str
    bar: float
    upper: bool = False  # True: the score must not exceed the bar. False: it must not be below the bar.


def parse_limit(text: str, upper: bool = False) -> Limit:
    """Parse a limit `name=number`.

    Raises:
        UsageError: If the text has another form.
    """
    name, _, number = text.partition("=")
    try:
        return Limit(name.strip(), float(number), upper)
    except ValueError:
        raise UsageError(f"{text!r} is not a limit of a score; write e.g. person_recall=0.98") from None


def failures(scores: Mapping[str, Any], limits: Sequence[Limit]) -> list[str]:
    """Return one phrase for every limit that the scores violate; an undefined score violates its limit.

    Raises:
        UsageError: If there is no score of that name.
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
