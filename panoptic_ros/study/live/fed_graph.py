"""The live graph after detection in processes of its own, fed from this one, and what is seen of it."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

from panoptic_ros.running.processes.children import Processes
from panoptic_ros.running.processes.usage import Usage, usage_of
from panoptic_ros.study.live.flooding import Flood, Flooder, floods_of
from panoptic_ros.study.live.graph_feed import Feed
from panoptic_ros.study.live.graph_figures import Flooded, Observation, Restart, figures_of
from panoptic_ros.study.live.player import LAST_WORDS_S, SETTLE_NS, Player, played

RESTART_PATIENCE_S = 60.0  # for skeletons after a process was killed


def run_fed_graph(
    feed: Feed, seconds: float, node_per_stage: bool, kill: bool = False, flood_s: float = 0.0
) -> dict[str, Any]:
    """Feed the graph until skeletons have come for so long; see `bench.graph_figures.figures_of`.

    Args:
        kill: afterwards kill each process in turn, to see how long it is silent and whom it still knows.
        flood_s: afterwards send floods of bad messages, each for so long; 0: none.

    Raises:
        UserError: as a node printed it, if one ended.
        EnvironmentProblem: if another graph runs in this ROS domain, or no skeletons come.
    """
    floods = floods_of(feed.rig.names[0], node_per_stage) if flood_s else []
    observation: Observation = played(
        feed, node_per_stage, lambda: _Run(feed, seconds, kill, floods, flood_s)
    )
    return figures_of(observation)


class _Run(Player):
    """Plays, then kills and floods if that is asked for."""

    def __init__(self, feed: Feed, seconds: float, kill: bool, floods: Sequence[Flood], flood_s: float):
        super().__init__(feed, kill)
        self._seconds, self._kill = seconds, kill
        self._floods, self._flood_s = floods, flood_s

    def do(self, processes: Processes) -> Observation:
        """See `Player`."""
        ids = processes.ids
        before: Usage | None = None
        while before is None or time.monotonic_ns() < before.at_ns + 1e9 * self._seconds:
            self.play()
            if self.number % 15 == 0:
                processes.check()
            if before is None and self.is_settled():
                before = usage_of(ids)
        after = usage_of(ids)
        sent = list(self.sent)
        restarts = [self._restart(processes, name) for name in processes.names] if self._kill else []
        floods = [self._flood(processes, flood) for flood in self._floods]
        if floods:
            sent = list(self.sent)
        self.spin_until(time.monotonic_ns() + round(1e9 * LAST_WORDS_S))
        return Observation(
            sent,
            self.received,
            self.feed.period_ns,
            self.started,
            before.at_ns,
            before,
            after,
            self.node.diagnostics,
            restarts,
            floods,
        )

    def _restart(self, processes: Processes, name: str) -> Restart:
        """Kill a process, and play on until its successor has settled."""
        self.play_until(time.monotonic_ns() + SETTLE_NS)
        _, before = self.newest
        killed = time.monotonic_ns()
        since, back = self.stamps_from + killed, None
        processes.kill(name)
        while back is None and time.monotonic_ns() < killed + 1e9 * RESTART_PATIENCE_S:
            self.play()
            processes.revive()
            back = next((when for stamp, when in reversed(self.received) if stamp > since), None)
        self.play_until(time.monotonic_ns() + SETTLE_NS)
        came = [when for stamp, when in self.received if stamp > since]
        silence_s = 1e-9 * (min(came) - killed) if came else None
        return Restart(name, silence_s, before, self.newest[1])

    def _flood(self, processes: Processes, flood: Flood) -> Flooded:
        """Play on while bad messages come."""
        self.play_until(time.monotonic_ns() + SETTLE_NS)
        begun = time.monotonic_ns()
        with Flooder(flood, self._flood_s) as flooder:
            while not flooder.over:
                self.play()
                if self.number % 15 == 0:
                    processes.check()
            messages = flooder.sent()
        ended = self.sent[-1][1]
        self.play_until(time.monotonic_ns() + SETTLE_NS)
        return Flooded(flood.title, messages, begun, ended)
