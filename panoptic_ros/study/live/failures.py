"""A long live run in which cameras die and come back and processes are killed at random."""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np

from panoptic_ros.running.processes.children import Processes
from panoptic_ros.running.processes.usage import usage_of
from panoptic_ros.stage import Progress
from panoptic_ros.study.live.graph_feed import Feed
from panoptic_ros.study.live.player import LAST_WORDS_S, SETTLE_NS, Player, played
from panoptic_ros.study.live.soak_figures import Failure, Soaked, soak_figures

SECOND = 1_000_000_000
LOOKS = 20  # at the memory
LEAST_VIEWS = 3  # cameras that stay alive
AWAY_S = (1.0, 8.0)  # how long a camera is away


def run_soak(
    feed: Feed, seconds: float, node_per_stage: bool, kill_s: float, away_s: float, progress: Progress
) -> dict[str, Any]:
    """Play for so long; see `bench.soak_figures.soak_figures`.

    Args:
        kill_s, away_s: on average between two kills, and between two cameras that die.

    Raises:
        UserError, EnvironmentProblem: as `running.benches.player.played`.
    """
    run: Soaked = played(feed, node_per_stage, lambda: _Soak(feed, seconds, kill_s, away_s, progress))
    return soak_figures(run)


class _Soak(Player):
    def __init__(self, feed: Feed, seconds: float, kill_s: float, away_s: float, progress: Progress):
        super().__init__(feed, revived=True)
        self._seconds, self._progress = seconds, progress
        self._kill_s, self._away_s = kill_s, away_s
        self._rng = np.random.default_rng(1)
        self._seen: Counter[int] = Counter()
        self._failures: list[Failure] = []
        self._returns: dict[str, tuple[int, int]] = {}  # of cameras: when, and the number of the failure
        self._killed: tuple[int, int] | None = None  # since when a process is away, and the failure

    def took(self, stamp_ns: int, when_ns: int, ids: frozenset[int]) -> None:
        """See `Player`."""
        self._seen.update(ids)
        if self._killed is not None and stamp_ns - self.stamps_from > self._killed[0]:
            self._end(self._killed[1], when_ns)
            self._killed = None

    def do(self, processes: Processes) -> Soaked:
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
        return Soaked(
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
