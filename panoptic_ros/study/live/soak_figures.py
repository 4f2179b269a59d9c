"""What a long live run with failures comes to: lost instants by cause, identities, memory."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

SECOND = 1_000_000_000
TOLD_NS = 2 * SECOND  # so long after an instant its loss is on /diagnostics
AFTER_NS = SECOND  # so long after a camera went or came, what is lost is put down to that


@dataclass(frozen=True)
class Failure:
    """Something that was done to the graph; ns of the monotonic clock.

    Args:
        cause: in words. ended_ns: when skeletons came again (a process), or the camera did.
    """

    cause: str
    begun_ns: int
    ended_ns: int


@dataclass(frozen=True)
class Soaked:
    """One run.

    Args:
        sent: of every instant: stamp, and when it was sent. stamps: of /skeletons.
        period_ns: between instants.
        people: identities at the beginning. at_end: at the end. seen: in how many sets each identity was.
        memory_mb: of all processes, time and again.
        dropped: by stage and cause, as nodes counted. counted: when these counts went up, and which.
    """

    sent: Sequence[tuple[int, int]]
    stamps: Sequence[int]
    period_ns: int
    failures: Sequence[Failure]
    people: frozenset[int]
    at_end: frozenset[int]
    seen: Mapping[int, int]
    memory_mb: Sequence[float]
    dropped: Mapping[str, int]
    counted: Sequence[tuple[int, str]] = ()


def soak_figures(run: Soaked) -> dict[str, Any]:
    """The numbers, for JSON."""
    lost: Counter[str] = Counter()
    stamps = np.sort(np.array(run.stamps, np.int64))
    for stamp, when in run.sent:
        place = int(np.searchsorted(stamps, stamp - run.period_ns // 2))
        if place == len(stamps) or stamps[place] > stamp + run.period_ns // 2:
            lost[_cause(when, run)] += 1
    half = run.memory_mb[len(run.memory_mb) // 2 :] or run.memory_mb
    return {
        "instants": len(run.sent),
        "lost": sum(lost.values()),
        "lost_by_cause": dict(sorted(lost.items())),
        "failures": len(run.failures),
        "people": len(run.people),
        "kept": len(run.people & run.at_end),
        "identities": len(run.seen),
        "memory_mb": list(run.memory_mb),
        "growth_mb": float(half[-1] - half[0]) if half else 0.0,
        "dropped": dict(run.dropped),
    }


def _cause(when_ns: int, run: Soaked) -> str:
    """The newest failure that an instant falls into, else what nodes counted then."""
    for failure in reversed(run.failures):
        if failure.begun_ns - SECOND // 10 <= when_ns <= failure.begun_ns + AFTER_NS:
            return failure.cause
        if failure.begun_ns <= when_ns <= failure.ended_ns + AFTER_NS:
            return failure.cause
    told = {name for at, name in run.counted if when_ns - SECOND // 10 <= at <= when_ns + TOLD_NS}
    return f"counted as {', '.join(sorted(told))}" if told else "none of these"
