"""`panoptic bench soak`: a long live run in which cameras and processes fail at random."""

from __future__ import annotations

import argparse
import os
from typing import Any

from panoptic_ros.bench.graph_feed import simulated_feed
from panoptic_ros.errors import UsageError
from panoptic_ros.stage import Progress, untold

ABOUT = "a long live run: cameras die and come back, processes are killed"
SCENARIO = "noisy-8p5v"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the bench."""
    parser.add_argument("--minutes", type=float, default=3.0, metavar="M", help="default 3")
    parser.add_argument("--rate", type=float, default=30.0, metavar="HZ", help="default 30")
    parser.add_argument("--hosts", choices=("one", "stage"), default="stage", help="default stage")
    parser.add_argument("--kill-every", type=float, default=20.0, metavar="S", help="a process; default 20")
    parser.add_argument("--away-every", type=float, default=8.0, metavar="S", help="a camera; default 8")
    parser.add_argument("--people", type=int, metavar="N", help=f"in place of those of {SCENARIO}")
    parser.add_argument("--views", type=int, metavar="N", help=f"in place of those of {SCENARIO}")


def measure(args: argparse.Namespace, progress: Progress = untold) -> dict[str, Any]:
    """Run the graph.

    Raises:
        UsageError: on numbers that make no sense.
        UserError, EnvironmentProblem: as `running.benches.player.played`.
    """
    from panoptic_ros.running.benches.failures import run_soak  # needs ROS

    if not 0.2 <= args.minutes <= 3000.0 or not 1.0 <= args.rate <= 240.0 or args.kill_every < 10.0:
        raise UsageError("give 0.2 to 3000 minutes, 1 to 240 Hz, and 10 s or more between two kills")
    feed = simulated_feed(SCENARIO, args.people, args.views, args.rate)
    found = run_soak(
        feed, 60.0 * args.minutes, args.hosts == "stage", args.kill_every, args.away_every, progress
    )
    return {
        "bench": "soak",
        "source": feed.title,
        "views": len(feed.rig),
        "rate_hz": feed.rate,
        "minutes": args.minutes,
        "hosts": args.hosts,
        "cores": os.cpu_count(),
        "load": os.getloadavg()[0],
        **found,
    }


def lines(result: dict[str, Any]) -> list[str]:
    """What happened."""
    out = [
        f"{result['source']}, {result['views']} views at {result['rate_hz']:g} Hz for {result['minutes']:g} "
        f"minutes, {result['failures']} failures; {result['cores']} cores, load {result['load']:.1f}",
        f"identities: {result['kept']} of {result['people']} kept, {result['identities']} in all",
        f"instants without skeletons: {result['lost']} of {result['instants']}",
    ]
    out += [f"  {cause}: {count}" for cause, count in result["lost_by_cause"].items()]
    out.append("nodes counted, over their restarts:")
    out += [f"  {cause}: {count}" for cause, count in result["dropped"].items()]
    memory = result["memory_mb"]
    told = " ".join(f"{value:.0f}" for value in memory)
    return [*out, f"memory of all processes, MB: {told}; second half {result['growth_mb']:+.1f}"]
