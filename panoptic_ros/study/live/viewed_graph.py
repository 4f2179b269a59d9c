"""Run a live graph with viewers, and measure its cost and the data that the viewers receive."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from panoptic_ros.nodes.sources.preview_feeding_node import PreviewFeedingNode
from panoptic_ros.running.processes.children import Processes, child_environment
from panoptic_ros.running.processes.usage import usage_of
from panoptic_ros.running.viewer.process import viewer
from panoptic_ros.stage import Progress, untold
from panoptic_ros.study.live.graph_feed import Feed
from panoptic_ros.study.live.graph_figures import arrivals
from panoptic_ros.study.live.player import Player, played
from panoptic_ros.study.live.view_feed import PREVIEW_EVERY, moving_previews
from panoptic_ros.study.live.view_figures import Phase, ages_of
from panoptic_ros.view.page.clients import WARM_S

Audience = tuple[str, Sequence[str]]  # name, kinds of clients as in `view.page.clients`
LAST_WORDS_S = 0.5  # wait for skeletons of the last time steps
FIND_S = 2.0  # time for discovery between the viewer and the graph


def run_viewed_graph(
    feed: Feed, seconds: float, audiences: Sequence[Audience], progress: Progress = untold
) -> list[Phase]:
    """Play 2D poses and previews to a live graph, with one audience after the other.

    Returns:
        one phase per audience.

    Raises:
        UserError: with the output of a node that ended.
        EnvironmentProblem: if another graph runs in this ROS domain, or it or the viewer does not start.
    """
    phases: list[Phase] = played(feed, False, lambda: _PreviewPlayer(feed, seconds, audiences, progress))
    return phases


class _PreviewPlayer(Player):
    """Player that also publishes preview images at every third time step."""

    def __init__(self, feed: Feed, seconds: float, audiences: Sequence[Audience], progress: Progress):
        super().__init__(feed, revived=False)
        self._seconds, self._audiences, self._progress = seconds, audiences, progress
        self._cameras = PreviewFeedingNode(feed.rig.names)
        self._executor.add_node(self._cameras)
        self._previews = [
            {name: self._cameras.message_of(preview) for name, preview in previews.items()}
            for previews in moving_previews(feed.rig)
        ]
        self._took: list[float] = []  # ms, duration of each publication

    def do(self, processes: Processes) -> list[Phase]:
        """See `Player`."""
        try:
            while not self.is_settled():
                self.play()
            with viewer(["--live"]) as (process, address):
                self._play_for(FIND_S)
                phases = []
                for done, (name, kinds) in enumerate(self._audiences):
                    processes.check()
                    self._progress(done / len(self._audiences), f"before {name}")
                    phases.append(self._phase(name, kinds, process, address))
                return phases
        finally:
            self._cameras.destroy_node()

    def publish(self, message: Any, stamp_ns: int) -> None:
        """Publish a view, and its preview if one is due."""
        begun = time.perf_counter()
        if self.number % PREVIEW_EVERY == 0:
            images = self._previews[self.number // PREVIEW_EVERY % len(self._previews)]
            camera = message.header.frame_id
            self._cameras.publish(camera, images[camera], stamp_ns)
        super().publish(message, stamp_ns)
        self._took.append(1e3 * (time.perf_counter() - begun))

    def _play_for(self, seconds: float) -> None:
        self.play_until(time.monotonic_ns() + round(1e9 * seconds))

    def _phase(self, name: str, kinds: Sequence[str], process: int, address: str) -> Phase:
        """Play with one audience and return its figures."""
        command = [sys.executable, "-m", "panoptic_ros.view.page.clients", address, str(self._seconds)]
        with tempfile.TemporaryFile("w+") as told:  # the output of ten clients would fill a pipe
            clients = subprocess.Popen([*command, *kinds], stdout=told, env=child_environment())
            took, first, last, cpu_percent, memory_mb = self._watched(clients, process)
            told.seek(0)
            rows = json.load(told)
        came = arrivals(self.sent, self.received, self.feed.period_ns)
        latencies = [1e-6 * (came[k] - self.sent[k][1]) for k in range(first, last) if k in came]
        per_block, measured = round(self.feed.rate), np.array(latencies)
        return Phase(
            name,
            [measured[at : at + per_block] for at in range(0, len(measured), per_block)],
            took,
            last - first - len(measured),
            cpu_percent,
            memory_mb,
            [ages_of(row, self._cameras.published) for row in rows],
        )

    def _watched(
        self, clients: subprocess.Popen[bytes], process: int
    ) -> tuple[np.ndarray, int, int, float, float]:
        """Play until the clients end.

        Returns:
            duration of each publication (ms); first measured time step and the one after the last; processor
            time (% of a core) and memory (MB) of the viewer.
        """
        self._play_for(WARM_S)
        self._took.clear()
        first, before = len(self.sent), usage_of([process])
        self._play_for(self._seconds)
        last, after, took = len(self.sent), usage_of([process]), np.array(self._took)
        self._play_for(LAST_WORDS_S)
        while clients.poll() is None:
            self._play_for(0.2)
        wall_s = 1e-9 * (after.at_ns - before.at_ns)
        cpu_percent = 100.0 * (after.cpu_s - before.cpu_s) / wall_s
        return took, first, last, cpu_percent, after.resident_mb
