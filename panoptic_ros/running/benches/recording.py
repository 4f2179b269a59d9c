"""`panoptic bench recording`: the memory of a live run that records, with its time compressed."""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from panoptic_ros.bench.graph_feed import simulated_feed
from panoptic_ros.domain import RefinedPoseSet
from panoptic_ros.errors import UsageError
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.nodes import FUSION
from panoptic_ros.graph.pipeline import records_of
from panoptic_ros.running.plans.plan import Plan
from panoptic_ros.running.processes.usage import usage_of
from panoptic_ros.running.runs.results import Results
from panoptic_ros.stage import Progress, StageContext, untold

ABOUT = "the memory of a live run that records, hours in minutes"
SCENARIO = "noisy-8p5v"
LOOKS = 10  # at the memory
BEGIN_NS = 1_700_000_000_000_000_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the bench."""
    parser.add_argument("--minutes", type=float, default=10.0, metavar="M", help="of the run; default 10")
    parser.add_argument("--rate", type=float, default=30.0, metavar="HZ", help="default 30")
    parser.add_argument("--people", type=int, default=3, metavar="N", help="default 3")
    parser.add_argument("--views", type=int, default=4, metavar="N", help="default 4")


def measure(args: argparse.Namespace, progress: Progress = untold) -> dict[str, Any]:
    """Give a live run's recorder what so many minutes bring, as fast as it takes it.

    Raises:
        UsageError: on numbers that make no sense.
    """
    if not 0.1 <= args.minutes <= 6000.0 or not 1.0 <= args.rate <= 240.0:
        raise UsageError(f"{args.minutes:g} minutes at {args.rate:g} Hz: give 0.1 to 6000 and 1 to 240")
    feed = simulated_feed(SCENARIO, args.people, args.views, args.rate)
    configs = configure({"refinement": {"lag": 0.0}})
    poses: list[RefinedPoseSet] = records_of(
        "skeletons", feed.sets, configs, StageContext(feed.rig, feed.skeleton), FUSION
    )
    count = round(60.0 * args.minutes * args.rate)
    plan = Plan("bench", feed.rig, feed.skeleton, configs, stage="sync", frame_rate=feed.rate, live=True)
    rows, begun = [], time.monotonic()
    with tempfile.TemporaryDirectory(prefix="panoptic-bench-") as folder:
        with Results(Path(folder), plan) as results:
            for number in range(count):
                stamp = BEGIN_NS + number * feed.period_ns
                for offset, view in feed.views(feed.number_of_set(number)):
                    results.take("detections", replace(view, stamp_ns=stamp + offset, frame_number=number))
                pose = poses[min(feed.number_of_set(number), len(poses) - 1)]
                results.take("skeletons", replace(pose, stamp_ns=stamp, index=number))
                if (number + 1) % max(1, count // LOOKS) == 0:
                    rows.append(_row(number + 1, feed.rate))
                    progress((number + 1) / count, "records are taken")
        size_mb = 1e-6 * sum(path.stat().st_size for path in Path(folder).rglob("*") if path.is_file())
    half = rows[len(rows) // 2 - 1 :]
    minutes = half[-1]["minutes"] - half[0]["minutes"]
    growth = (half[-1]["resident_mb"] - half[0]["resident_mb"]) / max(1e-9, minutes) * 60.0
    return {
        "bench": "recording",
        "rate_hz": feed.rate,
        "people": args.people,
        "views": len(feed.rig),
        "seconds": time.monotonic() - begun,
        "written_mb": size_mb,
        "mb_per_hour": growth,
        "rows": rows,
    }


def _row(number: int, rate: float) -> dict[str, float]:
    return {"minutes": number / rate / 60.0, "resident_mb": usage_of([os.getpid()]).resident_mb}


def lines(result: dict[str, Any]) -> list[str]:
    """The table."""
    out = [
        f"a live run that records {result['people']} people in {result['views']} views at "
        f"{result['rate_hz']:g} Hz; {result['seconds']:.0f} s, {result['written_mb']:.0f} MB written",
        "",
        f"{'minutes':>10}{'memory, MB':>14}",
    ]
    out += [f"{row['minutes']:>10.1f}{row['resident_mb']:>14.1f}" for row in result["rows"]]
    return [*out, "", f"growth in the second half: {result['mb_per_hour']:.0f} MB an hour"]
