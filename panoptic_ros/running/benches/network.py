"""`panoptic bench network`: 2D people from one host to another while packets are lost."""

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

from panoptic_ros.errors import EnvironmentProblem, UsageError
from panoptic_ros.running.benches.network_hosts import two_hosts
from panoptic_ros.running.processes.children import PROFILE, child_environment, profile_path
from panoptic_ros.stage import Progress, untold

ABOUT = "2D people from host to host with packets lost (network namespaces, root)"
CAMERAS = ("cam0", "cam1", "cam2")
MODULE = "panoptic_ros.nodes.sources.network_probe"
BEFORE_S, AFTER_S = 8.0, 6.0  # of sending: discovery, and what is repaired later


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the bench."""
    parser.add_argument("--loss", type=float, default=5.0, metavar="PERCENT", help="of packets; default 5")
    parser.add_argument("--seconds", type=float, default=10.0, metavar="S", help="of loss; default 10")


def measure(args: argparse.Namespace, progress: Progress = untold) -> dict[str, Any]:
    """Send with the profile of the graph, and with the middleware's own.

    Raises:
        UsageError: on numbers that make no sense.
        EnvironmentProblem: where there can be no hosts.
    """
    if not 0.1 <= args.loss <= 50.0 or not 1.0 <= args.seconds <= 600.0:
        raise UsageError("give 0.1 to 50 percent and 1 to 600 seconds")
    rows = []
    for k, with_profile in enumerate((True, False)):
        rows.append(_run(args.loss / 100.0, args.seconds, with_profile))
        progress((k + 1) / 2, "hosts talk")
    return {
        "bench": "network",
        "loss_percent": args.loss,
        "seconds": args.seconds,
        "load": os.getloadavg()[0],
        "rows": rows,
    }


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
            raise EnvironmentProblem("the receiving host gave nothing; is the machine out of memory?")
        return {"profile": with_profile, **figures(json.loads(out.read_text()), begun, ended)}


def figures(came: list[list[Any]], begun: float, ended: float) -> dict[str, Any]:
    """What was lost of the messages that were sent from `begun` to `ended`, how old the others were when they
    came, and the longest time in which nothing came of a camera.
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


def lines(result: dict[str, Any]) -> list[str]:
    """The table."""
    out = [
        f"{len(CAMERAS)} cameras, 10 kB at 30 Hz, {result['loss_percent']:g} % of packets lost for "
        f"{result['seconds']:g} s; load {result['load']:.1f}",
        "",
        f"{'':<26}{'sent':>7}{'lost':>7}{'p50 ms':>9}{'p99 ms':>9}{'silence s':>11}",
    ]
    for row in result["rows"]:
        name = "config/fastdds.xml" if row["profile"] else "the middleware's own"
        out.append(
            f"{name:<26}{row['sent']:>7}{row['lost']:>7}{row['p50_ms']:>9.1f}{row['p99_ms']:>9.1f}"
            f"{row['silence_s']:>11.2f}"
        )
    return out
