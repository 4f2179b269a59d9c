"""`panoptic bench graph`: the live graph after detection, fed with 2D people at their rate."""

from __future__ import annotations

import argparse
import os
from typing import Any

from panoptic_ros.bench.graph_feed import Feed, recorded_feed, simulated_feed
from panoptic_ros.errors import UsageError
from panoptic_ros.stage import Progress, each, untold

ABOUT = "the live graph after detection, over DDS: what is lost, latency, processor time"
SCENARIO = "noisy-8p5v"
HOSTS = {"one": "one process", "stage": "a process per stage"}
TABLE = (
    ("instants sent", "sent", 0),
    ("  skeletons received", "received", 0),
    ("  lost", "lost", 0),
    ("latency p50, ms", "latency_p50_ms", 1),
    ("  p90", "latency_p90_ms", 1),
    ("  p99", "latency_p99_ms", 1),
    ("  most", "latency_max_ms", 1),
    ("processor time, % of a core", "cpu_percent", 1),
    ("first skeletons after, s", "first_skeletons_s", 1),
    ("memory, MB", "resident_mb", 0),
    ("  growth, MB", "growth_mb", 1),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the bench."""
    parser.add_argument("--rate", type=float, default=30.0, metavar="HZ", help="default 30")
    parser.add_argument("--seconds", type=float, default=20.0, metavar="S", help="that count; default 20")
    parser.add_argument(
        "--hosts",
        choices=(*HOSTS, "both"),
        default="both",
        help="all stages in one process, a process per stage, or one after the other (default)",
    )
    parser.add_argument("--scenario", default=SCENARIO, metavar="NAME", help=f"default {SCENARIO}")
    parser.add_argument("--people", type=int, metavar="N", help="in place of the scenario's")
    parser.add_argument("--views", type=int, metavar="N", help="in place of the scenario's")
    parser.add_argument("--kill", action="store_true", help="then kill each process, and see who comes back")
    parser.add_argument(
        "--flood",
        type=float,
        nargs="?",
        const=10.0,
        default=0.0,
        metavar="S",
        help="then send bad messages on every topic, S seconds each (default 10; 42 are 100,000 messages)",
    )
    parser.add_argument("--bag", metavar="DIR", help="2D people of a bag in place of simulated ones")


def measure(args: argparse.Namespace, progress: Progress = untold) -> dict[str, Any]:
    """Run the graph once for each choice of processes, on the same data.

    Raises:
        UsageError: on numbers that make no sense.
        UserError: as a node printed it, if one ended.
        EnvironmentProblem: if another graph runs in this ROS domain, or this one gives nothing.
    """
    from panoptic_ros.running.benches.fed_graph import run_fed_graph  # needs ROS

    if not 1.0 <= args.rate <= 240.0 or not 1.0 <= args.seconds <= 3600.0:
        raise UsageError(f"{args.rate:g} Hz for {args.seconds:g} s: give 1 to 240 Hz and 1 to 3600 s")
    feed = _feed(args)
    chosen = list(HOSTS) if args.hosts == "both" else [args.hosts]
    return {
        "bench": "graph",
        "source": feed.title,
        "views": len(feed.rig),
        "rate_hz": feed.rate,
        "seconds": args.seconds,
        "cores": os.cpu_count(),
        "load": os.getloadavg()[0],
        "rows": [
            {"hosts": hosts, **run_fed_graph(feed, args.seconds, hosts == "stage", args.kill, args.flood)}
            for hosts in each(chosen, len(chosen), progress, "the graph runs")
        ],
    }


def lines(result: dict[str, Any]) -> list[str]:
    """The table."""
    rows = result["rows"]
    out = [
        f"{result['source']}, {result['views']} views at {result['rate_hz']:g} Hz for "
        f"{result['seconds']:g} s; {result['cores']} cores, load {result['load']:.1f} before",
        "",
        f"{'':<28}" + "".join(f"{HOSTS[row['hosts']]:>22}" for row in rows),
    ]
    for title, key, digits in TABLE:
        out.append(f"{title:<28}" + "".join(_cell(row[key], digits) for row in rows))
    out.append("step p50, ms")
    for stage in rows[0]["steps_ms"]:
        out.append(f"{'  ' + stage:<28}" + "".join(_cell(row["steps_ms"].get(stage), 2) for row in rows))
    for row in rows:
        out += [_restart_line(restart) for restart in row["restarts"]]
        out += [_flood_line(flood) for flood in row["floods"]]
    for row in rows:
        told = ", ".join(f"{cause} {count}" for cause, count in row["dropped"].items())
        if told:
            out.append(f"{HOSTS[row['hosts']]}: dropped since the start: {told}")
    return out


def _restart_line(restart: dict[str, Any]) -> str:
    silence = restart["silence_s"]
    came = "no skeletons came back" if silence is None else f"skeletons after {silence:.2f} s"
    return f"{restart['process']} killed: {came}, {restart['kept']} of {restart['people']} identities kept"


def _flood_line(flood: dict[str, Any]) -> str:
    return (
        f"{flood['title']} ({flood['messages']} in all): {flood['lost']} of {flood['instants']} instants "
        f"lost, longest gap {flood['longest_gap_s']:.2f} s, {flood['odd_stamps']} odd stamps"
    )


def _cell(value: float | None, digits: int) -> str:
    return f"{'-':>22}" if value is None else f"{value:>22.{digits}f}"


def _feed(args: argparse.Namespace) -> Feed:
    if not args.bag:
        return simulated_feed(args.scenario, args.people, args.views, args.rate)
    if args.people or args.views:
        raise UsageError("--people and --views are of a simulation; leave them out with --bag")
    return recorded_feed(args.bag, args.rate)
