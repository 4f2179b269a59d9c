"""Compute the figures of a live graph from its observation: losses, latency, processor time, memory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from panoptic_ros.running.processes.usage import Usage


@dataclass(frozen=True)
class Restart:
    """A process that was killed and restarted.

    Args:
        silence_s: time (s) from the kill to skeletons of a later time step; None = none arrived.
        before: identities in the last skeletons before the kill.
        after: identities some time after the restart.
    """

    process: str
    silence_s: float | None
    before: frozenset[int]
    after: frozenset[int]


@dataclass(frozen=True)
class FloodRecord:
    """A flood of bad messages.

    Args:
        title: description.
        messages: number of bad messages sent.
        begun_ns, ended_ns: times of the monotonic clock.
    """

    title: str
    messages: int
    begun_ns: int
    ended_ns: int


@dataclass(frozen=True)
class Observation:
    """One run of the graph; all times are of one monotonic clock.

    Args:
        sent: (ns) timestamp and publication time of the last view, for every time step.
        received: (ns) timestamp and arrival time of every message on /skeletons.
        period_ns: (ns) time between two time steps.
        started_ns: (ns) start time of the processes.
        measured_ns: (ns) time from which latencies count.
        before, after: Resource usage of the processes at the beginning and at the end of the measured part.
        stages: Last diagnostics of every stage.
        restarts: Restarts after the measured part.
        floods: Floods after the measured part.
    """

    sent: Sequence[tuple[int, int]]
    received: Sequence[tuple[int, int]]
    period_ns: int
    started_ns: int
    measured_ns: int
    before: Usage
    after: Usage
    stages: Mapping[str, Mapping[str, str]]
    restarts: Sequence[Restart] = ()
    floods: Sequence[FloodRecord] = ()


def figures_of(seen: Observation) -> dict[str, Any]:
    """Return the figures of one run, for JSON."""
    came = arrivals(seen.sent, seen.received, seen.period_ns)
    measured = [k for k, (_, published) in enumerate(seen.sent) if published >= seen.measured_ns]
    latencies = np.array([1e-6 * (came[k] - seen.sent[k][1]) for k in measured if k in came])
    duration_s = 1e-9 * (seen.after.at_ns - seen.before.at_ns)
    return {
        "restarts": [
            {
                "process": each.process,
                "silence_s": each.silence_s,
                "people": len(each.before),
                "kept": len(each.before & each.after),
            }
            for each in seen.restarts
        ],
        "floods": [_flood_figures(flood, seen, came) for flood in seen.floods],
        "sent": len(measured),
        "received": len(latencies),
        "lost": len(measured) - len(latencies),
        **{f"latency_{name}_ms": value for name, value in _percentiles(latencies).items()},
        "first_skeletons_s": 1e-9 * (min(when for _, when in seen.received) - seen.started_ns),
        "cpu_percent": 100.0 * (seen.after.cpu_s - seen.before.cpu_s) / duration_s,
        "resident_mb": seen.after.resident_mb,
        "growth_mb": seen.after.resident_mb - seen.before.resident_mb,
        "steps_ms": {
            stage: float(values["step_p50_ms"])
            for stage, values in seen.stages.items()
            if values.get("step_p50_ms", "nan") != "nan"
        },
        "dropped": {
            f"{stage}.{key.removeprefix('dropped.')}": int(count)
            for stage, values in seen.stages.items()
            for key, count in values.items()
            if key.startswith("dropped.")
        },
    }


def _flood_figures(flood: FloodRecord, seen: Observation, came: Mapping[int, int]) -> dict[str, Any]:
    """Return the cost of a flood.

    It consists of time steps without skeletons, the longest time without any, and timestamps far from every
    time step.
    """
    meanwhile = [k for k, (_, sent) in enumerate(seen.sent) if flood.begun_ns <= sent <= flood.ended_ns]
    moments = [flood.begun_ns, *sorted(when for _, when in seen.received), flood.ended_ns]
    inside = [when for when in moments if flood.begun_ns <= when <= flood.ended_ns]
    stamps = np.array([stamp for stamp, _ in seen.sent])
    odd = [
        stamp
        for stamp, when in seen.received
        if flood.begun_ns <= when <= flood.ended_ns
        and int(np.abs(stamps - stamp).min()) > seen.period_ns // 2
    ]
    return {
        "title": flood.title,
        "messages": flood.messages,
        "instants": len(meanwhile),
        "lost": sum(k not in came for k in meanwhile),
        "longest_gap_s": 1e-9 * float(np.diff(inside).max()),
        "odd_stamps": len(odd),
    }


def arrivals(
    sent: Sequence[tuple[int, int]], received: Sequence[tuple[int, int]], period_ns: int
) -> dict[int, int]:
    """Return the first arrival time of skeletons by index of the time step; arguments as in `Observation`.

    The timestamp of a set is that of one of its views, so it is matched to the nearest time step.
    """
    stamps = np.array([stamp for stamp, _ in sent])
    middles = (stamps[1:] + stamps[:-1]) // 2
    found: dict[int, int] = {}
    for stamp, when in received:
        nearest = int(np.searchsorted(middles, stamp))
        if abs(int(stamps[nearest]) - stamp) <= period_ns // 2:
            found.setdefault(nearest, when)
    return found


def _percentiles(values: np.ndarray) -> dict[str, float | None]:
    """Return the percentiles of the values; None without values, because JSON has no NaN."""
    names = {"p50": 50, "p90": 90, "p99": 99, "max": 100}
    if not len(values):
        return dict.fromkeys(names)
    return {name: float(np.percentile(values, share)) for name, share in names.items()}
