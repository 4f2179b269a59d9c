"""The study `network`: 2D poses sent from one host to another with packet loss."""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.errors import EnvironmentProblem
from panoptic_ros.running.arguments import within
from panoptic_ros.running.processes.children import PROFILE, child_environment, profile_path
from panoptic_ros.stage import Progress
from panoptic_ros.study.live.network_hosts import two_hosts
from panoptic_ros.study.study import Case, Column, Result, Row, Study

CAMERAS = ("cam0", "cam1", "cam2")
MODULE = "panoptic_ros.nodes.sources.network_probe"
# s of sending before and after the loss: for discovery, and for late retransmission
BEFORE_S, AFTER_S = 8.0, 6.0


class Network(Study):
    """Cameras send with the profile of the graph, and with the middleware's own."""

    columns = (
        Column("settings", ""),
        Column("sent", "sent"),
        Column("lost", "lost"),
        Column("p50_ms", "p50 ms", ".1f"),
        Column("p99_ms", "p99 ms", ".1f"),
        Column("silence_s", "silence s", ".2f"),
    )

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        parser.add_argument(
            "--loss",
            type=within(float, 0.1, 50.0),
            default=5.0,
            metavar="PERCENT",
            help="share of lost packets; default 5",
        )
        parser.add_argument(
            "--seconds",
            type=within(float, 1.0, 600.0),
            default=10.0,
            metavar="S",
            help="duration of the loss; default 10",
        )

    def cases(self) -> list[Case]:
        """See `Study`."""
        return [Case("config/fastdds.xml", True), Case("the middleware's own", False)]

    def measure(self, case: Case, progress: Progress) -> list[Row]:
        """See `Study`."""
        found = _run(self.options.loss / 100.0, self.options.seconds, case.request)
        return [{"settings": case.title, "load": os.getloadavg()[0], **found}]

    def head(self, result: Result) -> str:
        """See `Study`."""
        return (
            f"{len(CAMERAS)} cameras, 10 kB at 30 Hz, {self.options.loss:g} % of packets lost for "
            f"{self.options.seconds:g} s; load {result['rows'][0]['load']:.1f}"
        )


def _run(loss: float, seconds: float, with_profile: bool) -> dict[str, Any]:
    environment = child_environment()
    environment |= {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}
    environment.pop(PROFILE, None)
    if with_profile:
        environment[PROFILE] = str(profile_path())
    whole = BEFORE_S + seconds + AFTER_S
    with tempfile.TemporaryDirectory(prefix="panoptic-bench-") as folder, two_hosts() as hosts:
        out = Path(folder) / "came.json"
        program = [sys.executable, "-m", MODULE]
        processes = [
            hosts.start(1, [*program, "receive", f"{whole + 2.0}", str(out), *CAMERAS], environment),
            hosts.start(0, [*program, "send", f"{whole + 3.0}", os.devnull, *CAMERAS], environment),
        ]
        try:
            time.sleep(BEFORE_S)
            begun = time.time()
            hosts.lose(loss)
            time.sleep(seconds)
            hosts.lose(0.0)
            ended = time.time()
            for process in processes:
                process.wait(whole + 20.0)
        finally:
            for process in processes:
                process.kill()
                process.wait()
        if not out.is_file():
            raise EnvironmentProblem("the receiving host sent nothing; is the machine out of memory?")
        return {"profile": with_profile, **figures(json.loads(out.read_text()), begun, ended)}


def figures(came: list[list[Any]], begun: float, ended: float) -> dict[str, Any]:
    """Return the number of lost messages, the latency of received ones, and a camera's longest silence.

    Only messages sent from `begun` to `ended` are used.
    """
    sent = lost = 0
    latencies: list[float] = []
    silences: list[float] = []
    for camera in sorted({row[0] for row in came}):
        own = [row for row in came if row[0] == camera]
        inside = [row for row in own if begun <= row[3] - row[2] <= ended]
        numbers = {row[1] for row in inside}
        count = max(numbers) - min(numbers) + 1 if numbers else 0
        sent, lost = sent + count, lost + count - len(numbers)
        latencies += [row[2] for row in inside]
        moments = [begun, *sorted(row[3] for row in own if begun <= row[3]), ended]
        silences.append(float(np.diff(moments).max()) if len(moments) > 2 else ended - begun)
    p50, p99 = np.percentile(latencies, (50, 99)) if latencies else (np.nan, np.nan)
    return {
        "sent": sent,
        "lost": lost,
        "p50_ms": 1e3 * float(p50),
        "p99_ms": 1e3 * float(p99),
        "silence_s": max(silences, default=ended - begun),
    }
