"""A long live run in which cameras fail and processes are killed at random.

Its figures are lost time steps by cause, identities and memory.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from panoptic_ros.running.processes.children import Processes
from panoptic_ros.running.processes.usage import usage_of
from panoptic_ros.stage import Progress
from panoptic_ros.study.live.graph_feed import Feed
from panoptic_ros.study.live.player import LAST_WORDS_S, SETTLE_NS, Player, played

SECOND = 1_000_000_000
TOLD_NS = 2 * SECOND  # limit of the delay from a time step to the report of its loss on /diagnostics
AFTER_NS = SECOND  # a loss within this time after a camera left or returned is attributed to that event
LOOKS = 20  # memory measurements per run
LEAST_VIEWS = 3  # lower limit of active cameras
AWAY_S = (1.0, 8.0)  # range of the time that a camera is off


@dataclass(frozen=True)
class Failure:
    """A failure that the study caused; times are ns of the monotonic clock.

    Args:
        cause: description.
        begun_ns: time of the failure.
        ended_ns: time of the first skeletons afterwards (killed process), or of the camera event.
    """

    cause: str
    begun_ns: int
    ended_ns: int


@dataclass(frozen=True)
class SoakObservations:
    """Observations of one run.

    Args:
        sent: (ns) timestamp and publication time of every time step.
        stamps: (ns) timestamps on /skeletons.
        period_ns: (ns) time between two time steps.
        failures: failures in order.
        people, at_end: identities at the beginning and at the end.
        seen: number of sets per identity.
        memory_mb: (MB) memory of all processes, at regular times.
        dropped: drop counts of the nodes, by stage and cause.
        counted: (ns) time, and name of the count, for every increase of these counts.
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


def soak_figures(run: SoakObservations) -> dict[str, Any]:
    """Return the figures of a run, for JSON."""
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


def _cause(when_ns: int, run: SoakObservations) -> str:
    """Return the newest failure that can explain a lost time step, else the drop counts that rose then."""
    for failure in reversed(run.failures):
        if failure.begun_ns - SECOND // 10 <= when_ns <= failure.begun_ns + AFTER_NS:
            return failure.cause
        if failure.begun_ns <= when_ns <= failure.ended_ns + AFTER_NS:
            return failure.cause
    told = {name for at, name in run.counted if when_ns - SECOND // 10 <= at <= when_ns + TOLD_NS}
    return f"counted as {', '.join(sorted(told))}" if told else "none of these"


def run_soak(
    feed: Feed, seconds: float, node_per_stage: bool, kill_s: float, away_s: float, progress: Progress
) -> dict[str, Any]:
    """Run the graph for this time; see `soak_figures`.

    Args:
        kill_s: mean time (s) between two kills.
        away_s: mean time (s) between two camera failures.

    Raises:
        UserError: with the output of a node that ended.
        EnvironmentProblem: as `player.played`.
    """
    run: SoakObservations = played(
        feed, node_per_stage, lambda: _SoakPlayer(feed, seconds, kill_s, away_s, progress)
    )
    return soak_figures(run)


class _SoakPlayer(Player):
    def __init__(self, feed: Feed, seconds: float, kill_s: float, away_s: float, progress: Progress):
        super().__init__(feed, revived=True)
        self._seconds, self._progress = seconds, progress
        self._kill_s, self._away_s = kill_s, away_s
        self._rng = np.random.default_rng(1)
        self._seen: Counter[int] = Counter()
        self._failures: list[Failure] = []
        self._returns: dict[str, tuple[int, int]] = {}  # by camera: return time, index of its failure
        # kill time, index of the failure; None = all processes run
        self._killed: tuple[int, int] | None = None

    def took(self, stamp_ns: int, when_ns: int, ids: frozenset[int]) -> None:
        """See `Player`."""
        self._seen.update(ids)
        if self._killed is not None and stamp_ns - self.stamps_from > self._killed[0]:
            self._end(self._killed[1], when_ns)
            self._killed = None

    def do(self, processes: Processes) -> SoakObservations:
        """See `Player`."""
        while not self.is_settled():
            self.play()
            processes.check()
        begun, first = time.monotonic_ns(), self.number
        _, people = self.newest
        memory: list[float] = []
        next_kill, next_away = begun + self._wait(self._kill_s), begun + self._wait(self._away_s)
        while (now := time.monotonic_ns()) < begun + self._seconds * SECOND:
            self.play()
            processes.revive()
            if now >= next_kill:
                self._kill_one(processes)
                next_kill = now + self._wait(self._kill_s)
            if now >= next_away:
                self._send_one_away(now)
                next_away = now + self._wait(self._away_s)
            self._bring_back(now)
            if now - begun >= len(memory) * self._seconds * SECOND / LOOKS and self._killed is None:
                memory.append(usage_of(processes.ids).resident_mb)
                self._progress(min(0.99, len(memory) / LOOKS), "the graph runs")
        self.away.clear()
        counted = self.number
        for _ in range(round(3 * SETTLE_NS / self.feed.period_ns)):
            self.play()
            processes.revive()
        _, at_end = self.newest
        self.spin_until(time.monotonic_ns() + round(LAST_WORDS_S * SECOND))
        stamps = [stamp for stamp, _ in self.received]
        return SoakObservations(
            self.sent[first:counted],
            stamps,
            self.feed.period_ns,
            self._failures,
            people,
            at_end,
            self._seen,
            memory,
            self.node.drops.counts,
            self.node.drops.times,
        )

    def _wait(self, mean_s: float) -> int:
        return round(SECOND * mean_s * self._rng.uniform(0.5, 1.5))

    def _kill_one(self, processes: Processes) -> None:
        name = str(self._rng.choice(processes.names))
        killed = time.monotonic_ns()
        processes.kill(name)
        self._failures.append(Failure(f"process {name} was killed", killed, killed))
        self._killed = killed, len(self._failures) - 1

    def _send_one_away(self, now: int) -> None:
        there = [name for name in self.feed.rig.names if name not in self.away]
        if len(there) <= LEAST_VIEWS:
            return
        name = str(self._rng.choice(there))
        self.away.add(name)
        self._failures.append(Failure("a camera died or came back", now, now))
        self._returns[name] = now + round(SECOND * self._rng.uniform(*AWAY_S)), len(self._failures) - 1

    def _bring_back(self, now: int) -> None:
        for name in [name for name, (when, _) in self._returns.items() if now >= when]:
            del self._returns[name]
            self.away.discard(name)
            self._failures.append(Failure("a camera died or came back", now, now))

    def _end(self, number: int, when_ns: int) -> None:
        self._failures[number] = replace(self._failures[number], ended_ns=when_ns)
