"""`panoptic bench view`: what looking at a live graph costs it, and how old what people see is."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any

from panoptic_ros.bench.view_feed import PEOPLE, RATE_HZ, VIEWS, view_load
from panoptic_ros.bench.view_figures import NOBODY, table_of
from panoptic_ros.errors import UsageError
from panoptic_ros.running.benches.viewed_recording import open_and_seek
from panoptic_ros.stage import Progress, untold

ABOUT = "the viewer at a live graph: its load, what pages get, and what ten, slow and frozen ones change"
AUDIENCES: dict[str, tuple[str, ...]] = {
    "one": ("fast",),
    "slow": ("fast", "slow"),
    "frozen, cut": ("fast", "frozen", "cut"),
    "ten": ("fast",) * 10,
}
ROWS = (
    ("/skeletons", "messages", 0),
    ("lost", "lost", 0),
    ("p50, ms", "skeletons_p50_ms", 2),
    ("p99, ms", "skeletons_p99_ms", 2),
    ("p99 / that of nobody", "p99_ratio", 2),
    ("  95 % from", "ratio_low", 2),
    ("  to", "ratio_high", 2),
    ("publish a view p50, ms", "publish_p50_ms", 3),
    ("  p99", "publish_p99_ms", 3),
    ("viewer, % of a core", "viewer_cpu_percent", 1),
    ("viewer, MB", "viewer_mb", 0),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the bench."""
    parser.add_argument(
        "--recording",
        type=Path,
        metavar="RESULTS|BAG",
        help="open this and seek in it, in place of a live graph",
    )
    parser.add_argument("--seconds", type=float, default=8.0, metavar="S", help="for each; default 8")
    parser.add_argument(
        "--rounds",
        type=int,
        default=3,
        metavar="N",
        help="how often each has its turn, always after nobody; default 3",
    )


def measure(args: argparse.Namespace, progress: Progress = untold) -> dict[str, Any]:
    """Play the view load before audiences in turn, each round in another order, with nobody between them.

    Raises:
        UsageError: on a time that makes no sense.
        EnvironmentProblem: if another graph runs in this ROS domain, or the viewer does not start.
    """
    if args.recording is not None:
        return {
            "bench": "view",
            "recording": str(args.recording),
            "load": os.getloadavg()[0],
            **open_and_seek(args.recording),
        }
    from panoptic_ros.running.benches.viewed_graph import run_viewed_graph  # needs ROS

    if not 2.0 <= args.seconds <= 600.0:
        raise UsageError(f"--seconds {args.seconds:g}: give 2 to 600")
    if not 1 <= args.rounds <= 100:
        raise UsageError(f"--rounds {args.rounds}: give 1 to 100")
    turns = []
    for number in range(args.rounds):
        names = list(AUDIENCES)
        for name in names[number % len(names) :] + names[: number % len(names)]:
            turns += [(NOBODY, ()), (name, AUDIENCES[name])]
    progress(0.0, "simulating")
    feed = view_load()
    phases = run_viewed_graph(feed, args.seconds, turns, progress)
    progress(1.0, "")
    return {
        "bench": "view",
        "people": PEOPLE,
        "views": VIEWS,
        "rate_hz": RATE_HZ,
        "seconds": args.seconds,
        "rounds": args.rounds,
        "cores": os.cpu_count(),
        "load": os.getloadavg()[0],
        "rows": table_of(phases),
    }


def lines(result: dict[str, Any]) -> list[str]:
    """The tables."""
    if "recording" in result:
        return [
            f"{result['recording']}: {result['seconds']} s; load {result['load']:.1f}",
            f"from the command to the address {result['address_s']:.2f} s, to the first second of data "
            f"{result['first_s']:.2f} s",
            f"{result['seeks']} seeks: p50 {result['seek_p50_ms']:.0f} ms, p99 {result['seek_p99_ms']:.0f}, "
            f"most {result['seek_max_ms']:.0f} ms",
        ]
    rows = result["rows"]
    out = [
        f"{result['people']} people, {result['views']} cameras at {result['rate_hz']:g} Hz, previews at "
        f"10 Hz; {result['rounds']} times {result['seconds']:g} s each; "
        f"{result['cores']} cores, load {result['load']:.1f}",
        "",
        f"{'':<22}" + "".join(f"{row['audience']:>13}" for row in rows),
    ]
    for title, key, digits in ROWS:
        out.append(f"{title:<22}" + "".join(f"{row[key]:>13.{digits}f}" for row in rows))
    head = f"{'client':<22}{'packets':>9}{'age p50 ms':>12}{'p99 ms':>9}{'most':>8}{'MB/s':>7}{'skipped':>9}"
    out += ["", head]
    for row in rows:
        for each in row["clients"]:
            name = f"{row['audience']}: {each['kind']}"
            out.append(
                f"{name:<22}{each['packets']:>9}{each['age_p50_ms']:>12.1f}{each['age_p99_ms']:>9.1f}"
                f"{each['age_max_ms']:>8.0f}{each['megabytes_per_s']:>7.2f}{each['skipped']:>9}"
            )
    return out
